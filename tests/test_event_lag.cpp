#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "layers/event_lag.hpp"

using namespace ecir;

namespace {

constexpr uint32_t kWidth = 64;
constexpr uint32_t kHeight = 48;
constexpr int64_t kPeriod = 60'000; ///< from exposure to exposure, microseconds
constexpr int64_t kExposed = 40'000;

/// A texture that turns about, seen in exposures of 40 ms, with events that come late.
class Recording {
public:
    Recording(int exposures, int64_t lag) {
        const int64_t end = exposures * kPeriod + EventLagEstimator::kReach;
        std::vector<double> level(size_t{kWidth} * kHeight, 1e9);
        frames_.assign(static_cast<size_t>(exposures), std::vector<float>(level.size()));
        for (int64_t time = -EventLagEstimator::kReach; time <= end; time += kStep) {
            const auto index = static_cast<size_t>(std::max<int64_t>(time, 0) / kPeriod);
            const bool open = time >= 0 && index < frames_.size() && time % kPeriod < kExposed;
            for (size_t i = 0; i < level.size(); ++i) {
                const double value = brightness(i % kWidth, i / kWidth, time);
                if (open) {
                    frames_[index][i] += static_cast<float>(value * kStep / kExposed);
                }
                const double now = std::log(value + 0.01);
                level[i] = level[i] > 1e8 ? now : level[i];
                for (; std::abs(now - level[i]) >= 0.2; level[i] += now > level[i] ? 0.2 : -0.2) {
                    events_.push_back(time + lag, static_cast<uint16_t>(i % kWidth),
                                      static_cast<uint16_t>(i / kWidth), now > level[i] ? 1 : 0);
                }
            }
        }
    }

    [[nodiscard]] std::optional<int64_t> lag() const {
        EventLagEstimator estimator(kWidth, kHeight);
        for (size_t i = 0; i + 1 < frames_.size(); ++i) {
            estimator.add(frames_[i], exposure(i), frames_[i + 1], exposure(i + 1), events_.view());
        }
        return estimator.estimate();
    }

private:
    static constexpr int64_t kStep = 500;

    static double brightness(size_t column, size_t row, int64_t time) {
        const double seconds = static_cast<double>(time) * 1e-6;
        const double x = static_cast<double>(column) - 12 * std::sin(21 * seconds);
        const double y = static_cast<double>(row) - 9 * std::sin(17 * seconds + 1);
        return 0.45 + 0.2 * std::sin(0.4 * x) + 0.15 * std::sin(0.35 * y + 0.2 * x);
    }

    static Exposure exposure(size_t index) {
        const int64_t start = static_cast<int64_t>(index) * kPeriod;
        return {start, start + kExposed};
    }

    std::vector<std::vector<float>> frames_;
    Events events_;
};

} // namespace

TEST_SUITE("event lag") {
    TEST_CASE("found within a millisecond and a half, early and late") {
        for (const int64_t lag : {-8'000, 0, 5'000}) {
            CAPTURE(lag);
            const auto found = Recording(6, lag).lag();
            REQUIRE(found.has_value());
            CHECK(std::abs(*found - lag) <= 1'500);
        }
    }

    TEST_CASE("nothing is claimed of too few exposures, of still ones and of lags beyond reach") {
        CHECK_FALSE(Recording(3, 0).lag().has_value());
        CHECK_FALSE(Recording(6, 2 * EventLagEstimator::kReach).lag().has_value());
        EventLagEstimator still(kWidth, kHeight);
        const std::vector<float> frame(size_t{kWidth} * kHeight, 0.5F);
        for (int i = 0; i < 4; ++i) {
            still.add(frame, {0, kExposed}, frame, {kPeriod, kPeriod + kExposed}, {});
        }
        CHECK_FALSE(still.estimate().has_value());
    }
}
