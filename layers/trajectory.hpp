#pragma once
#include <cstdint>

#include "layers/motion.hpp"

namespace ecir {

/// Trajectories of the fusion network: the velocity field of layers/motion.hpp followed from a
/// wanted time to the anchors, whose frames are fetched from where they lead
/// (layers/fusion_fetch.hpp).

/// Records the displacements from a cell at the instant to where it is at the anchors.
/// velocity, away  of motion_layout(); velocities are finite
/// instant         one channel of instant_layout()
/// Throws Error(bad_input) for shapes that do not match.
void record_trajectory(Program& program, const Tensor& velocity, const Tensor& instant,
                       const Tensor& away);

} // namespace ecir
