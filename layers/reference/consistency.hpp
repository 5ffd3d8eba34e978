#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/consistency.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// What record_consistency(), once a frame, and record_consistent() make of frames, in double
/// precision. frames, prior: [shares][height][width]; blurry: [height][width].
std::vector<double> consistent(std::span<const float> frames, std::span<const float> prior,
                               std::span<const float> blurry, std::span<const float> shares,
                               uint32_t width);

} // namespace ecir::reference

namespace ecir {

/// Cases of them together (layers/consistency.hpp).
Trial consistency_trial(Device& device, uint32_t trial);

} // namespace ecir
