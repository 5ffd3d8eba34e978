#pragma once
#include <cstdint>
#include <span>

#include "layers/events.hpp"

namespace ecir {

/// How far what moves travels during the exposure, pixels (the length of its path), from the blurry
/// frame and its events alone: for each of 16 slices of time and each tile of the image the motion
/// v of least squares on dL/dt + v . grad L = 0, L = ln(I + 0.01) as the double integral gives it
/// at a threshold of 0.2 (Lucas and Kanade 1981, with the events for the derivative of time), the
/// lengths summed over the slices; of the tiles the median by what the motion explains. On
/// simulated scenes of 4 to 90 pixels with thresholds of 0.12 to 0.35 it is within 25 % (standard
/// deviation of its logarithm) and short by a third above 60 pixels. 0 where nothing moves.
///
/// On the host, on at most 256 pixels a side. blurry: height x width, 0 ... 1. events: of the
/// exposure, sorted, inside the image.
double estimate_travel(std::span<const float> blurry, const EventView& events,
                       const Exposure& exposure, uint32_t width, uint32_t height);

} // namespace ecir
