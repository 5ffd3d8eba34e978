#pragma once
#include <cstdint>

#include "layers/prior.hpp"

namespace ecir {

/// Motion from frames of the prior alone, by least squares, for the fusion network
/// (tools/train/motion.py): displacements over the gaps between the anchors in cells of 8 x 8
/// pixels, first by Lucas and Kanade over wide neighbourhoods, then by a round of Gauss and Newton
/// between neighbouring anchors.

inline constexpr uint32_t motion_rounds = 1;

/// Layout of displacements over the gaps for an image of height x width: x and y side by side, a
/// cell a pixel; and of displacements to the anchors.
Layout motion_layout(uint32_t height, uint32_t width);
Layout away_layout(uint32_t height, uint32_t width);

/// Records it.
/// logarithms  PriorExposure::logarithms, dense
/// moved       output of motion_layout(), pixels
/// channels    output, a twentieth of the velocity at the anchors, in pixels a unit of time, as
/// input
///             of a convolution: 2 * anchor_count channels of the same size, any layout
/// Throws Error(bad_input) for shapes that do not match; finish() throws Error(resources) when the
/// logarithms exceed what the device can bind.
void record_motion(Program& program, const Tensor& logarithms, const Tensor& moved,
                   const Tensor& channels);

} // namespace ecir
