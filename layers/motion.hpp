#pragma once
#include <cstdint>

#include "layers/prior.hpp"

namespace ecir {

/// Motion from frames of the prior alone, by least squares, for the fusion network
/// (tools/train/motion.py): velocities at the anchors in cells of 8 x 8 pixels, first by Lucas and
/// Kanade over wide neighbourhoods, then by rounds of Gauss and Newton between neighbouring
/// anchors.

inline constexpr uint32_t motion_rounds = 3;

/// Layout of a velocity, or of a displacement, at each anchor for an image of height x width: x and
/// y side by side, a cell a pixel.
Layout motion_layout(uint32_t height, uint32_t width);

/// Records it.
/// logarithms  PriorExposure::logarithms, dense
/// velocity    output of motion_layout(), pixels a unit of time
/// channels    output, a twentieth of `velocity` as input of a convolution: 2 * anchor_count
///             channels of the same size, any layout
/// Throws Error(bad_input) for shapes that do not match; finish() throws Error(resources) when the
/// logarithms exceed what the device can bind.
void record_motion(Program& program, const Tensor& logarithms, const Tensor& velocity,
                   const Tensor& channels);

} // namespace ecir
