#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/operations.hpp"
#include "layers/trajectory.hpp"

namespace ecir::reference {

/// What record_trajectory() computes at a time, in double precision: [2 * anchor_count][rows]
/// [columns]. moved: [2 * (anchor_count - 1)][rows][columns].
std::vector<double> trajectory(std::span<const float> moved, double time, uint32_t rows,
                               uint32_t columns);

/// What record_fusion_fetch() computes at a time: the differences [anchor_count][height][width],
/// nearest anchor first. away: as trajectory()'s result; prior: one frame.
std::vector<double> fusion_fetch(std::span<const float> anchors, std::span<const float> away,
                                 std::span<const float> prior, double time, uint32_t height,
                                 uint32_t width);

/// What record_reference_fetch() computes: the differences [reference_count][height][width].
/// references: as many frames; away, frame: as for fusion_fetch().
std::vector<double> reference_fetch(std::span<const float> references, std::span<const float> away,
                                    std::span<const float> frame, uint32_t height, uint32_t width);

} // namespace ecir::reference

namespace ecir {

/// Cases of record_trajectory() (layers/trajectory.hpp), of record_fusion_fetch() and of
/// record_reference_fetch() (layers/fusion_fetch.hpp).
Trial trajectory_trial(Device& device, uint32_t trial);
Trial fusion_fetch_trial(Device& device, uint32_t trial);
Trial reference_fetch_trial(Device& device, uint32_t trial);

} // namespace ecir
