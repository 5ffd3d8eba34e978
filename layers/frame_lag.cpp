#include "layers/frame_lag.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "layers/event_lag.hpp"
#include "layers/event_pack.hpp"

namespace ecir {
namespace {

/// At the times that times_of_change() tells, sorted by them.
Events at_their_change(const EventView& events, uint32_t width, uint32_t height) {
    const std::vector<double> times = times_of_change(events, width, height);
    std::vector<size_t> order(events.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(order, {}, [&](size_t i) { return times[i]; });
    Events result;
    for (const size_t i : order) {
        result.push_back(std::llround(times[i]), events.x[i], events.y[i], events.p[i]);
    }
    return result;
}

} // namespace

std::optional<double> FrameLagEstimator::estimate(std::span<const float> blurry,
                                                  const EventView& events, const Exposure& exposure,
                                                  double guess) {
    constexpr int kTests = 6;
    constexpr double kCloseEnough = 0.005;
    constexpr double kLargestError = 0.03;
    constexpr double kSteepest = -1.5; // of the test by the lag: mostly -0.3 to -1
    constexpr double kFlattest = -0.3;
    const Events changes = at_their_change(events, width_, height_);
    const auto duration = static_cast<double>(exposure.duration());
    const double start = guess / duration; // lags are shares of the exposure from here on
    const auto test = [&](double lag) {
        const int64_t shift = std::llround(lag * duration);
        const Exposure shifted = {exposure.start + shift, exposure.end + shift};
        const PackedEvents packed =
            pack_events(window(changes.view(), shifted), shifted, width_, height_);
        const EdiEstimate found = thresholds_.estimate(packed, blurry);
        return thresholds_.balance(packed, blurry, found.thresholds);
    };
    double lag = start;
    double slope = -1;
    EdiBalance here = test(lag);
    for (int tests = 1; tests < kTests && std::abs(here.lag) > kCloseEnough; ++tests) {
        const double next = std::clamp(lag - here.lag / slope, start - kReach, start + kReach);
        if (std::abs(next - lag) < kCloseEnough) {
            break;
        }
        const EdiBalance there = test(next);
        slope = std::clamp((there.lag - here.lag) / (next - lag), kSteepest, kFlattest);
        lag = next;
        here = there;
    }
    const double error = -here.lag_error / slope;
    // At the end of the reach the test may go on beyond it: at least so late, then.
    const bool settled = std::abs(here.lag) < std::max(2 * kCloseEnough, 2 * here.lag_error) ||
                         (std::abs(lag - start) >= kReach && (lag > start) == (here.lag > 0));
    return error < kLargestError && settled ? std::optional(lag * duration) : std::nullopt;
}

} // namespace ecir
