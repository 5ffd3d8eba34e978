#pragma once
#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "layers/events.hpp"

namespace ecir {

/// When the change that each event tells of happened on average: midway from its pixel's event
/// before where that has the same sign, since the brightness ran on between them. Stamps alone are
/// half a threshold late. events: sorted, inside the image; the times of a pixel stay so.
std::vector<double> times_of_change(const EventView& events, uint32_t width, uint32_t height);

/// How late events are against the frames: an event stamped t happened at t - lag on the frames'
/// clock. Found from neighbouring exposures: the logarithm of a blurry frame is close to the mean
/// over its exposure of ln I, so the change from one frame to the next is the sum over the events
/// of their sign times a weight that rises from 0 to 1 during the first exposure and falls back
/// during the second. Of the lags tried, the one at which that sum correlates best over the pixels
/// with the change seen (both smoothed), all pairs of exposures together.
class EventLagEstimator {
public:
    static constexpr int64_t kStep = 1000; ///< microseconds from one lag tried to the next
    static constexpr int kSteps = 20;      ///< to either side of 0
    static constexpr int64_t kReach = kStep * kSteps;

    EventLagEstimator(uint32_t width, uint32_t height) : width_(width), height_(height) {}

    /// first, second: height x width values, 0 ... 1, of exposures that follow each other without
    /// overlap. events: all from kReach before the start of the first exposure to kReach after the
    /// end of the second, sorted, inside the image. A pair in which hardly anything changes is
    /// passed over.
    void add(std::span<const float> first, const Exposure& first_exposure,
             std::span<const float> second, const Exposure& second_exposure,
             const EventView& events);

    /// Microseconds; none before three pairs told of a lag, and where the best lies at the end of
    /// the range. On a real recording single pairs differ by
    /// 3 ms (standard deviation), eight together come within about 2 ms.
    [[nodiscard]] std::optional<int64_t> estimate() const;

private:
    uint32_t width_;
    uint32_t height_;
    std::array<double, 2 * kSteps + 1> correlation_{}; ///< summed over the pairs
    int pairs_ = 0;
};

} // namespace ecir
