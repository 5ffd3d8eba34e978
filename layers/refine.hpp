#pragma once
#include <array>
#include <cstdint>

#include "runtime/program.hpp"

namespace ecir {

/// The two kernels of the refinement (algorithm 1 of the paper) that are not convolutions.

/// Input channels of the residual network of interval i: frame i, frame i + 1, d/dx and d/dy of
/// frame i, d/dx and d/dy of frame i + 1, positive and negative events of the interval, and (i > 0)
/// residual i - 1.
inline constexpr uint32_t residual_channels(uint32_t interval) {
    return interval == 0 ? 8 : 9;
}

/// Records the input of the residual network of `interval`. A gradient is the left (upper)
/// neighbour less the pixel, 0 in the first column (row). frames     d frames, any layout counts 2
/// (d - 1) event counts, any layout residuals  d - 1 residuals, any layout; read for interval > 0
/// only input      output of residual_channels(interval) channels, any layout; the halo and what
/// fills up the
///            last block are left alone
void record_refine_input(Program& program, const Tensor& frames, const Tensor& counts,
                         const Tensor& residuals, uint32_t interval, const Tensor& input);

/// alpha_net of the published weights: 3x3 weights by rows, then the bias.
using AlphaWeights = std::array<float, 10>;

/// Records one gradient step on equation 8 with lambda = 1 for all frames at once:
///     alpha_i = 0.1 ReLU(conv3x3(L_i) + bias)     (zeros outside the image)
///     D_i     = 2 (L_i - L0_i) - 2 (L_{i-1} + R_{i-1} - L_i) [i > 0]
///                              + 2 (L_i + R_i - L_{i+1})     [i < d - 1]
///     L_i    <- L_i - alpha_i D_i
/// initial    L0, d channels
/// frames     L, d channels, not the same memory as `updated`
/// residuals  R, d - 1 channels; not looked at when d = 1
/// updated    the new L, d channels; its halo is left alone
/// All of one height and width, block 1, any halo. Throws Error(resources) when three frames exceed
/// what the device can bind.
void record_refine_update(Program& program, const Tensor& initial, const Tensor& frames,
                          const Tensor& residuals, const AlphaWeights& alpha,
                          const Tensor& updated);

} // namespace ecir
