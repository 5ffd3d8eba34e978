#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/event_pack.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// Event counts by the rules of layers/histogram.hpp, applied to every event and every interval as
/// they are written there: dense [2 (edges - 1)][height][width]. `release` chooses the release
/// rule.
std::vector<double> histogram(const EventView& events, const Exposure& exposure,
                              std::span<const double> edges, bool release, uint32_t width,
                              uint32_t height);

} // namespace ecir::reference

namespace ecir {

/// Sorted events for the cases: random ones, bursts at one microsecond, a busy pixel, the
/// exposure's ends, and events exactly on multiples of a `grid`-th of the exposure.
Events random_events(CaseRandom& random, const Exposure& exposure, uint32_t width, uint32_t height,
                     uint32_t count, uint32_t grid);

/// Sorted events spread evenly over the exposure and, at random, over the pixels.
Events even_events(CaseRandom& random, const Exposure& exposure, uint32_t width, uint32_t height,
                   uint32_t count);

Trial event_histogram_trial(Device& device, uint32_t trial);

} // namespace ecir
