#pragma once
#include "layers/instant.hpp"
#include "runtime/program.hpp"

namespace ecir {

/// Data consistency of an exposure's corrected frames: their mean over the exposure is the captured
/// frame, which the prior's mean already is. So what the corrections of the prior add up to,
///     m(x) = sum over i of share_i (frame_i(x) - prior_i(x)),
/// smoothed a little, comes off every frame again; the smoothing leaves a part of the captured
/// frame's noise out. 0 where a frame or the captured one reaches consistency_limit, since the
/// sensor clips after averaging. The shares (layers/instant.hpp) are 0 for times that do not cover
/// the exposure, and frames are left as they are.

/// Of full scale.
inline constexpr float consistency_limit = 0.97F;

/// What adds up from frame to frame. Zeros before the first.
Layout consistency_state_layout(uint32_t height, uint32_t width);

/// Records what a frame adds to the state.
/// frame, prior, blurry  1 channel of one size, block 1, any halo and pitch
/// instant               one channel of instant_layout()
/// last                  whether it is the last frame of the exposure
/// Throws Error(bad_input) for shapes that do not match; finish() throws Error(resources) when a
/// tensor exceeds what the device can bind (as record_consistent()).
void record_consistency(Program& program, const Tensor& frame, const Tensor& prior,
                        const Tensor& blurry, const Tensor& instant, const Tensor& state,
                        bool last);

/// Records the change of all frames, in place.
/// state   after the last frame
/// frames  a channel each, block 1
void record_consistent(Program& program, const Tensor& state, const Tensor& frames);

} // namespace ecir
