#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/operations.hpp"

namespace ecir::reference {

/// out[o][y][x] = sum over i, ky, kx of w[o][i][ky][kx] in[i][stride y + ky - k/2][stride x + kx -
/// k/2], zero outside the image. in: channels x height x width; weight: [out][channels][k][k].
/// Returns out x ceil(height / stride) x ceil(width / stride).
std::vector<double> conv(std::span<const double> in, uint32_t channels, uint32_t height,
                         uint32_t width, std::span<const float> weight, uint32_t out,
                         uint32_t kernel, uint32_t stride);

/// The stride-2 transposed convolution: each input pixel adds w[i][o][ky][kx] in[i][y][x] to
/// out[o][2 y + ky - k/2][2 x + kx - k/2]. weight: [channels][out][k][k].
std::vector<double> conv_transposed(std::span<const double> in, uint32_t channels, uint32_t height,
                                    uint32_t width, std::span<const float> weight, uint32_t out,
                                    uint32_t kernel, uint32_t out_height, uint32_t out_width);

} // namespace ecir::reference

namespace ecir {

/// Cases of layers/conv.hpp with the device's own family of kernels, and with the other one.
Trial conv_trial(Device& device, uint32_t trial);
Trial conv_tile_trial(Device& device, uint32_t trial);
/// The other one in float16, and by cooperative matrices.
Trial conv_tile_half_trial(Device& device, uint32_t trial);
Trial conv_matrix_trial(Device& device, uint32_t trial);
/// Cases of the row family where the device has it.
Trial conv_row_trial(Device& device, uint32_t trial);
/// Convolutions with one output channel (layers/conv_plane.hpp).
Trial conv_plane_trial(Device& device, uint32_t trial);
/// Two convolutions to one channel in one (layers/conv_pair.hpp).
Trial conv_pair_trial(Device& device, uint32_t trial);

} // namespace ecir
