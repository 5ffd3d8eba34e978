#pragma once
#include "layers/fusion_fetch.hpp"

namespace ecir {

/// Refinement across time. A corrected frame's remaining errors are mostly its own: other frames of
/// the exposure, fetched along the motion, have others. So each is averaged with those of the
/// start, the middle and the end (reference_count) as far as they agree:
///     frame + sum over i of w_i d_i / (1 + sum over i of w_i),
///     w_i = exp(-mean of d_i^2 over 3x3 pixels / agreement_tolerance^2),
/// d_i the difference of reference i, 0 outside the image (leaving those out gains 0.003 dB). Fixed
/// references make a frame a function of its time alone, whichever other times are wanted.

/// Of full scale. Measured on simulated scenes: 0.015 does what 0.02 does, and less harm where
/// objects hide each other; at 0.03 frames get smeared.
inline constexpr float agreement_tolerance = 0.015F;

/// Records it.
/// differences  from record_reference_fetch()
/// frame, to    1 channel of one size, block 1, any halo and pitch; not the same
/// Throws Error(bad_input) for shapes that do not match; finish() throws Error(resources) when a
/// tensor exceeds what the device can bind.
void record_agreement(Program& program, const Tensor& differences, const Tensor& frame,
                      const Tensor& to);

} // namespace ecir
