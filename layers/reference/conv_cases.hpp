#pragma once
#include <cstdint>
#include <vector>

namespace ecir {

/// A convolution that the operations table tries (layers/reference/conv.cpp).
struct ConvCase {
    uint32_t kernel = 3;
    uint32_t stride = 1;
    bool transposed = false;
    std::vector<uint32_t> inputs; ///< channels of each input tensor
    uint32_t out = 1;
    uint32_t height = 1; ///< of the output when transposed, else of the input
    uint32_t width = 1;
    bool bias = true;
    bool relu = true;
    bool residual = false;
    uint32_t planar = 0; ///< so many of the inputs, the first ones, have block 1

    bool operator==(const ConvCase&) const = default;
};

/// Small: every kernel, stride and number of inputs, channels that fill blocks and that do not, odd
/// sizes, one pixel, both tiles of the lane family, several slices and several chunks of weights.
const std::vector<ConvCase>& small_convs();

/// For the row family: its kernels and strides, both numbers of channels a workgroup, one slice and
/// several, odd sizes, one pixel, a residual by rows and in blocks.
const std::vector<ConvCase>& small_row_convs();

/// Those of the shipped networks at 240x180, each shape once, with the widths of the weights files:
/// of the fusion networks of all sizes, the largest first, and of `ecir`. Throws Error(bad_input)
/// where a file is missing.
std::vector<ConvCase> network_convs();

} // namespace ecir
