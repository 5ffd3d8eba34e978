#pragma once
#include <cstdint>

#include "layers/motion.hpp"

namespace ecir {

/// Trajectories of the fusion network: the velocity field of layers/motion.hpp followed from a
/// wanted time to the anchors, whose frames are fetched from where they lead.

/// Records the displacements from a cell at the instant to where it is at the anchors.
/// velocity, away  of motion_layout(); instant: one channel of instant_layout()
void record_trajectory(Program& program, const Tensor& velocity, const Tensor& instant,
                       const Tensor& away);

/// Records the differences between the anchors fetched along `away` and the prior at the instant,
/// nearest in time first: channels 2 to 10 of `planes`, of which channel 0 must be there.
/// anchors  PriorExposure::anchors of block 1; planes: see record_prior_frame()
void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes);

/// All throw Error(bad_input) for shapes that do not match.

} // namespace ecir
