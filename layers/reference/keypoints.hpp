#pragma once
#include <cstdint>
#include <vector>

#include "layers/event_pack.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// Keypoints by the definition in layers/keypoints.hpp, dense [n][height][width]: every event
/// against the rational borders and pivots in 64-bit integers. `release` measures time from the
/// sensor's first event (0) to its last (1) instead of over the exposure.
std::vector<double> keypoints(const EventView& events, const Exposure& exposure, uint32_t n,
                              bool release, uint32_t width, uint32_t height);

} // namespace ecir::reference

namespace ecir {

Trial keypoints_trial(Device& device, uint32_t trial);

} // namespace ecir
