#pragma once
#include <cstdint>
#include <optional>
#include <span>

#include "layers/edi_threshold.hpp"
#include "layers/events.hpp"

namespace ecir {

/// How late events are against a single frame, from what moves during its exposure: the lag at
/// which EdiBalance::lag comes out 0, with thresholds estimated anew at each that is tried. Mostly
/// within 2 % of the exposure, and closer than neighbouring exposures tell (layers/event_lag.hpp)
/// unless it is much shorter than the lag.
class FrameLagEstimator {
public:
    /// Lags that can be found, as a share of the exposure to either side of a first guess.
    static constexpr double kReach = 0.4;

    /// Throws Error(bad_input) for less than edi_smallest_side pixels a side.
    FrameLagEstimator(Device& device, uint32_t width, uint32_t height)
        : width_(width), height_(height), thresholds_(device, width, height) {}

    /// Microseconds. blurry: height x width values, 0 ... 1. guess: microseconds. events: sorted,
    /// inside the image, from kReach of the exposure before its start + guess to as much after its
    /// end + guess; where those outside it are missing, a lag comes out too small, as one beyond
    /// kReach does. None where too little moves to tell. Throws as pack_events() and
    /// EdiThresholdEstimator::estimate().
    std::optional<double> estimate(std::span<const float> blurry, const EventView& events,
                                   const Exposure& exposure, double guess);

private:
    uint32_t width_;
    uint32_t height_;
    EdiThresholdEstimator thresholds_;
};

} // namespace ecir
