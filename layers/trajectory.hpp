#pragma once
#include <cstdint>

#include "layers/motion.hpp"

namespace ecir {

/// Trajectories of the fusion network: the motion of layers/motion.hpp followed from a wanted time
/// to the anchors, whose frames are fetched from where they lead
/// (layers/fusion_fetch.hpp).

/// Records the displacements from a cell at the instant to where it is at the anchors.
/// moved    from record_motion(); finite
/// instant  one channel of instant_layout()
/// away     output of away_layout()
/// Throws Error(bad_input) for shapes that do not match.
void record_trajectory(Program& program, const Tensor& moved, const Tensor& instant,
                       const Tensor& away);

} // namespace ecir
