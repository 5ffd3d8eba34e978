#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/motion.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// What record_motion() computes, in double precision: displacements over the gaps,
/// [2 (anchor_count - 1)][rows][columns]. logarithms: [prior_windows + 1][height][width].
std::vector<double> motion(std::span<const float> logarithms, uint32_t height, uint32_t width);

/// The velocity at the anchors, [2 anchor_count][rows][columns], from motion()'s result.
std::vector<double> anchor_velocity(std::span<const double> moved);

} // namespace ecir::reference

namespace ecir {

/// Cases of record_motion() (layers/motion.hpp), and those of stripes that no axis is along.
Trial motion_trial(Device& device, uint32_t trial);
Trial motion_oblique_trial(Device& device, uint32_t trial);

} // namespace ecir
