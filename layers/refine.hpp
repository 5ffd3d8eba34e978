#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <optional>

#include "runtime/program.hpp"

namespace ecir {

/// The kernels of the refinement (algorithm 1 of the paper) that are not convolutions, on a state
/// that its residual networks read where it lies: for each of d frames the planes
///     frame i, d/dx and d/dy of it, positive and other events of interval i, residual i - 1,
/// so that the nine inputs of interval i are nine planes in a row, the last three being frame i + 1
/// and its gradients. Interval 0 has no residual before it: that plane stays zero.

inline constexpr uint32_t refine_planes = 6;         ///< of a frame
inline constexpr uint32_t refine_residual_plane = 5; ///< among them
inline constexpr uint32_t refine_network_inputs = 9;

/// Layout of the state; to be cleared once, since its halo is read and nothing writes it.
inline Layout refine_state_layout(uint32_t frames, uint32_t height, uint32_t width) {
    return {refine_planes * frames, height, width, 1, 1};
}

/// The planes that the residual network of `interval` reads, and the one that it writes.
inline Tensor refine_network_input(const Tensor& state, uint32_t interval) {
    return state.channels(refine_planes * interval, refine_network_inputs);
}
inline Tensor refine_residual(const Tensor& state, uint32_t interval) {
    return state.channels(refine_planes * (interval + 1) + refine_residual_plane, 1);
}

/// Records the frames, their gradients and, if given, the event counts into the state. A gradient
/// is the left (upper) neighbour less the pixel, 0 in the first column (row).
/// frames     d frames, block 1, any halo
/// counts     2 (d - 1) event counts, block 1, any halo; nullptr: those in the state stay
/// together   frames a dispatch at most
void record_refine_state(Program& program, const Tensor& frames, const Tensor* counts,
                         const Tensor& state, uint32_t together = UINT32_MAX);

/// alpha_net of the published weights: 3x3 weights by rows, then the bias.
using AlphaWeights = std::array<float, 10>;

/// The largest step that never lets equation 8 with lambda = 1 grow, 1 / (3 + 2 cos(pi / d)) > 1/5:
/// 2 over the largest eigenvalue of its Hessian 2 (I + D^T D), where D takes the differences of a
/// pixel's d neighbouring frames. A step -A grad with any diagonal 0 <= A <= a changes the
/// objective by -grad^T (A - A H A / 2) grad, which is not positive where a |H| <= 2, so a network
/// may choose a step for each pixel of each frame below it.
float largest_refine_step(uint32_t frames);

/// Records one gradient step on equation 8 with lambda = 1 for all frames at once:
///     alpha_i = min(0.1 ReLU(conv3x3(L_i) + bias), largest_step)     (zeros outside the image)
///     D_i     = 2 (L_i - L0_i) - 2 (L_{i-1} + R_{i-1} - L_i) [i > 0]
///                              + 2 (L_i + R_i - L_{i+1})     [i < d - 1]
///     L_i    <- L_i - alpha_i D_i
/// initial    L0, d channels
/// state      the frames L and the residuals R
/// updated    the new L, d channels; its halo is left alone
/// largest    one word: becomes at least the largest |new L - L|
/// together   frames a dispatch at most
/// All but the last of one height and width, block 1 and halo 1. Throws Error(resources) when three
/// frames' state exceeds what the device can bind.
void record_refine_update(Program& program, const Tensor& initial, const Tensor& state,
                          const AlphaWeights& alpha, const Tensor& updated, const Tensor& largest,
                          float largest_step = std::numeric_limits<float>::infinity(),
                          uint32_t together = UINT32_MAX);

/// Records moving = 1 where largest >= least and, if given, largest < before, else 0, one word
/// each; 0 where `largest` is not a number.
void record_refine_settled(Program& program, const Tensor& largest, float least,
                           const std::optional<Tensor>& before, const Tensor& moving);

} // namespace ecir
