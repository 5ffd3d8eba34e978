#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "layers/frame_lag.hpp"
#include "runtime/error.hpp"

using namespace ecir;

namespace {

constexpr uint32_t kWidth = 96;
constexpr uint32_t kHeight = 72;
constexpr int64_t kExposed = 80'000; ///< microseconds

/// A frame of a moving texture, and its events, which come late and go on before and after.
class Capture {
public:
    Capture(double travel, int64_t lag) : travel_(travel), frame_(size_t{kWidth} * kHeight) {
        std::vector<double> level(frame_.size(), 1e9);
        constexpr int64_t kStep = 400;
        constexpr auto kReach = static_cast<int64_t>(FrameLagEstimator::kReach * kExposed);
        for (int64_t time = -2 * kReach; time <= kExposed + 2 * kReach; time += kStep) {
            for (size_t i = 0; i < level.size(); ++i) {
                const double value = brightness(i % kWidth, i / kWidth, time);
                if (time >= 0 && time < kExposed) {
                    frame_[i] += static_cast<float>(value * kStep / kExposed);
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

    [[nodiscard]] std::optional<double> lag(double guess = 0) const {
        static const std::shared_ptr<Device> device = Device::open();
        FrameLagEstimator estimator(*device, kWidth, kHeight);
        return estimator.estimate(frame_, events_.view(), {0, kExposed}, guess);
    }

private:
    [[nodiscard]] double brightness(size_t column, size_t row, int64_t time) const {
        const double share = static_cast<double>(time) / kExposed;
        const double x = static_cast<double>(column) - travel_ * share;
        const double y = static_cast<double>(row) - 0.3 * travel_ * std::sin(3 * share);
        return 0.45 + 0.2 * std::sin(0.31 * x + 2 * std::sin(0.09 * y)) +
               0.15 * std::sin(0.35 * y + 0.2 * x);
    }

    double travel_;
    std::vector<float> frame_;
    Events events_;
};

} // namespace

TEST_SUITE("frame lag") {
    TEST_CASE("a single frame tells the lag of its events within 4 % of the exposure") {
        for (const double travel : {6.0, 14.0}) {
            for (const int64_t lag : {-9'000, 0, 4'000, 12'000}) {
                CAPTURE(travel);
                CAPTURE(lag);
                const auto found = Capture(travel, lag).lag();
                REQUIRE(found.has_value());
                CHECK(std::abs(*found - static_cast<double>(lag)) < 0.04 * kExposed);
            }
        }
    }

    TEST_CASE("a guess takes it beyond its own reach") {
        const auto found = Capture(12, 40'000).lag(35'000);
        REQUIRE(found.has_value());
        CHECK(std::abs(*found - 40'000) < 0.04 * kExposed);
    }

    TEST_CASE("nothing is claimed where nothing moves, and small sensors are refused") {
        CHECK_FALSE(Capture(0, 0).lag().has_value());
        CHECK_THROWS_AS(FrameLagEstimator(*Device::open(), 15, 40), Error);
    }
}
