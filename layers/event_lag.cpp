#include "layers/event_lag.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "layers/plane_smooth.hpp"

namespace ecir {
namespace {

constexpr float kOffset = 0.01F;
constexpr float kBlack = 0.03F; // darker than this and whiter than that the frame does not follow
constexpr float kWhite = 0.97F;
constexpr int kPairs = 3;

/// Share of an exposure that is over at a time, 0 to 1.
double share_over(const Exposure& exposure, double time) {
    const auto start = static_cast<double>(exposure.start);
    return std::clamp((time - start) / static_cast<double>(exposure.duration()), 0.0, 1.0);
}

/// Over the pixels where `use` is set; 0 where one does not vary.
double correlation(const std::vector<float>& a, const std::vector<float>& b,
                   const std::vector<bool>& use) {
    double n = 0;
    double sa = 0;
    double sb = 0;
    double aa = 0;
    double ab = 0;
    double bb = 0;
    for (size_t i = 0; i < a.size(); ++i) {
        if (use[i]) {
            const auto x = static_cast<double>(a[i]);
            const auto y = static_cast<double>(b[i]);
            n += 1;
            sa += x;
            sb += y;
            aa += x * x;
            ab += x * y;
            bb += y * y;
        }
    }
    const double spread = (n * aa - sa * sa) * (n * bb - sb * sb);
    return spread > 0 ? (n * ab - sa * sb) / std::sqrt(spread) : 0;
}

} // namespace

std::vector<double> times_of_change(const EventView& events, uint32_t width, uint32_t height) {
    struct Last {
        int64_t time = 0;
        int sign = -1;
    };
    std::vector<Last> last(size_t{width} * height);
    std::vector<double> times(events.size());
    for (size_t i = 0; i < events.size(); ++i) {
        Last& before = last[size_t{events.y[i]} * width + events.x[i]];
        const int sign = events.p[i] != 0 ? 1 : 0;
        const auto now = static_cast<double>(events.t[i]);
        times[i] = before.sign == sign ? 0.5 * (now + static_cast<double>(before.time)) : now;
        before = {events.t[i], sign};
    }
    return times;
}

void EventLagEstimator::add(std::span<const float> first, const Exposure& first_exposure,
                            std::span<const float> second, const Exposure& second_exposure,
                            const EventView& events) {
    constexpr double kTelling = 0.3; // correlation at the best lag, from which a pair counts
    const size_t pixels = size_t{width_} * height_;
    std::vector<float> change(pixels);
    std::vector<bool> use(pixels);
    for (size_t i = 0; i < pixels; ++i) {
        const auto inside = [](float value) { return value > kBlack && value < kWhite; };
        use[i] = inside(first[i]) && inside(second[i]);
        change[i] =
            std::log((std::max(second[i], 0.0F) + kOffset) / (std::max(first[i], 0.0F) + kOffset));
    }
    smooth_plane(change, width_, height_); // a pixel's own threshold noise must not decide

    const std::vector<double> times = times_of_change(events, width_, height_);
    std::array<double, 2 * kSteps + 1> found{};
    for (size_t place = 0; place < found.size(); ++place) {
        const double lag = (static_cast<double>(place) - kSteps) * kStep;
        std::vector<float> sum(pixels);
        for (size_t i = 0; i < events.size(); ++i) {
            const double time = times[i] - lag;
            const double weight =
                share_over(first_exposure, time) - share_over(second_exposure, time);
            sum[size_t{events.y[i]} * width_ + events.x[i]] +=
                static_cast<float>(events.p[i] != 0 ? weight : -weight);
        }
        smooth_plane(sum, width_, height_);
        found[place] = correlation(sum, change, use);
    }
    if (*std::ranges::max_element(found) < kTelling) {
        return;
    }
    for (size_t i = 0; i < found.size(); ++i) {
        correlation_[i] += found[i];
    }
    ++pairs_;
}

std::optional<int64_t> EventLagEstimator::estimate() const {
    constexpr int kAround = 5; // steps: the top is flat, so the slopes beside it tell more
    const auto best =
        static_cast<int>(std::ranges::max_element(correlation_) - correlation_.begin());
    const int around = std::min({kAround, best, 2 * kSteps - best});
    if (pairs_ < kPairs || around < 2) {
        return std::nullopt;
    }
    // Least squares of a parabola; over places symmetric to the best its terms are independent.
    double places = 0;
    double fourth = 0;
    double slope = 0;
    double bend = 0;
    const double n = 2 * around + 1;
    for (int k = -around; k <= around; ++k) {
        places += double{1} * k * k / n;
        fourth += std::pow(k, 4) / n;
    }
    for (int k = -around; k <= around; ++k) {
        const int place = best + k;
        const double value = correlation_[static_cast<size_t>(place)];
        slope += k * value / (n * places);
        bend += (k * k - places) * value / (n * (fourth - places * places));
    }
    if (bend >= 0) {
        return std::nullopt;
    }
    const double top = std::clamp(-0.5 * slope / bend, -1.0 * around, 1.0 * around);
    return std::llround((best - kSteps + top) * kStep);
}

} // namespace ecir
