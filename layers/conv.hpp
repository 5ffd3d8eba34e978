#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "runtime/program.hpp"

namespace ecir {

/// The families of convolution kernels.
enum class ConvFamily {
    lane, ///< shaders/conv_lane.comp, for drivers that run on a CPU; reads by device address
    row,  ///< shaders/conv_row.comp and conv_row_up.comp, for the same; tensors by rows
    tile, ///< shaders/conv_tile.glsl, storage buffers only, for GPUs and everything else; in
          ///< float16 shaders/conv_matrix.glsl where use_matrices()
};

constexpr uint32_t kConvTileBlock = 8; ///< channel block of the tile family
constexpr uint64_t kConvUniformSlice =
    65536; ///< bytes of weights that a lane-family dispatch can see

/// The family for a device: lane on a CPU driver that has device addresses, else tile.
/// ECIR_CONV=tile or =matrix in the environment gives tile everywhere, to check on a CPU driver
/// what a GPU would run.
ConvFamily conv_family(const DeviceInfo& info);

/// Images of a size whose work goes on side by side, each with tensors of its own, to keep a device
/// full: on the lane family 1, which has the caches for itself; else as many as have half a million
/// pixels together, 16 at most.
uint32_t images_at_once(const DeviceInfo& info, uint32_t height, uint32_t width);

/// Lines of invocations in a workgroup of the tile family: LY of shaders/conv_tile.glsl, LINES, of
/// a subgroup each, of conv_matrix.glsl.
inline constexpr uint32_t conv_tile_lines = 4;

/// Whether float16 convolutions with so many output channels go through cooperative matrices: where
/// the device has them, for at least a matrix's columns of channels; with ECIR_CONV=tile none do.
bool use_matrices(const DeviceInfo& info, uint32_t out_channels);

/// Throws Error(usage) where a device's convolutions do not know a precision: float16 is of the
/// tile family, on devices that has_float16().
void check_precision(const DeviceInfo& info, Precision precision);

/// Which families convolutions use on a device, and why, for a person: lines of text.
std::string explain_convolutions(const DeviceInfo& info);

/// Channels a block of a tensor that convolutions work on: 8, or the subgroup's 16 lanes.
uint32_t channel_block(const DeviceInfo& info);

constexpr uint32_t kConvRowGroup = 4; ///< output channels a workgroup of the row family
/// Lanes that the row family is fast with: with 16 (LP_NATIVE_VECTOR_WIDTH=512) loads no longer
/// become vector loads, and networks take five times as long on Mesa 25.0.7.
constexpr uint32_t kConvRowLanes = 8;

/// The family for a network part whose convolutions have these output channels: row instead of lane
/// where all are multiples of kConvRowGroup. It knows 1x1, 3x3, 5x5 of stride 2 and transposed
/// ones, and is faster at each shape of the networks, 15x12 included (shaders/conv_row.comp).
ConvFamily row_family(const DeviceInfo& info, std::span<const uint32_t> out_channels);
/// The same for parts whose largest tensor, `most` elements, may be more than the device binds:
/// tensors by rows are bound as a whole, those of the other families a few channels at a time.
ConvFamily row_family(const DeviceInfo& info, std::span<const uint32_t> out_channels,
                      uint64_t most);

/// The layout of a tensor between convolutions of a family; by rows of few sizes (row_pixels()).
Layout conv_layout(const DeviceInfo& info, ConvFamily family, uint32_t channels, uint32_t height,
                   uint32_t width, uint32_t halo = 0);
/// The layout of what a family's first convolution reads, and other kernels read and write plane by
/// plane.
Layout image_layout(const DeviceInfo& info, ConvFamily family, uint32_t channels, uint32_t height,
                    uint32_t width, uint32_t halo = 0);

struct ConvDesc {
    uint32_t out_channels = 1;
    uint32_t kernel = 3;     ///< 1, 3 or 5, square
    uint32_t stride = 1;     ///< 1 or 2
    bool transposed = false; ///< stride-2 transposed; the output's size says the output padding
    bool relu = false;
    /// Most output channels that a dispatch of the lane family binds, a multiple of the block, so
    /// that large outputs stay within what a device binds; 0: as many as their weights allow.
    uint32_t most_bound = 0;
    /// What the tile family multiplies in; unset: what the device was opened for.
    std::optional<Precision> precision = {};
    /// Output rows that an invocation of the tile family computes: 8, 4, 2 or 1, with stride 2 at
    /// most 2; 0: by the output's size.
    uint32_t tile_rows = 0;
    /// Of float16: through cooperative matrices or not; unset: use_matrices().
    std::optional<bool> matrices = {};
};

/// Input channels of a convolution in the order of one input tensor: for each channel of the tensor
/// its index among the weight's input channels. A convolution over a concatenation takes a list of
/// these, a tensor each, and nothing is copied together.
using ChannelMap = std::vector<uint32_t>;

/// first, first + 1, ..., first + count - 1.
ChannelMap channel_range(uint32_t first, uint32_t count);

/// A convolution with zero padding kernel / 2, its weights packed and on the device:
/// out = activation(conv(concat(inputs)) + bias + residual).
class Conv {
public:
    /// weight: [out][in][k][k], transposed: [in][out][k][k] (PyTorch's orders), `in` being the
    /// number of channels that all maps name. bias: [out], or empty for none.
    /// Throws Error(device) for a kernel or stride it does not know and for sizes that disagree.
    Conv(Device& device, const ConvDesc& desc, const std::vector<ChannelMap>& inputs,
         std::span<const float> weight, std::span<const float> bias,
         std::optional<ConvFamily> family = {});

    /// Output pixels are ceil(H / stride) x ceil(W / stride); transposed: 2 H or 2 H - 1 as
    /// `output` has. Inputs need a halo of kernel / 2 (transposed: 1) zeros and their channel
    /// padding finite; block channel_block() or 1. Output and residual have block channel_block().
    /// Row family: inputs of conv_layout(), output of that or another layout of block 1, the
    /// residual of any.
    /// The output's halo is not written. Throws Error(device) where shapes disagree.
    void record(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                const std::optional<Tensor>& residual = {}) const;
    void record(Program& program, const Tensor& input, const Tensor& output,
                const std::optional<Tensor>& residual = {}) const {
        record(program, std::span(&input, 1), output, residual);
    }

private:
    /// Taps of one sub-pixel phase: input row = stride y + ky - pad_y, output row = step y +
    /// offset_y.
    struct Phase {
        uint32_t kernel_h;
        uint32_t kernel_w;
        uint32_t pad_y;
        uint32_t pad_x;
        uint32_t offset_y;
        uint32_t offset_x;
        std::vector<uint32_t> taps; ///< ky * kernel + kx in the weight, for each (row, column) here
    };
    struct Slice { ///< lane family: `count` input channels from `first` of one input
        uint32_t input;
        uint32_t first;
        uint32_t count;
        std::vector<uint64_t> offsets; ///< in weights_, for each chunk of output-channel groups
        uint32_t groups_per_chunk;
    };

    struct RowSlice { ///< row family: `count` input channels from `first` of one input
        uint32_t input;
        uint32_t first;
        uint32_t count;
        uint64_t offset; ///< in weights_, bytes
    };

    void make_phases();
    [[nodiscard]] float weight_at(std::span<const float> weight, uint32_t out, uint32_t in,
                                  uint32_t tap) const;
    void pack_lane(std::span<const float> weight);
    void pack_row(std::span<const float> weight, std::span<const float> bias);
    void pack_tile(std::span<const float> weight);
    void record_lane(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                     const std::optional<Tensor>& residual) const;
    void record_row(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                    const std::optional<Tensor>& residual) const;
    void record_tile(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                     const std::optional<Tensor>& residual) const;
    void check(std::span<const Tensor> inputs, const Tensor& output,
               const std::optional<Tensor>& residual) const;
    /// Element of a phase's first output pixel in what is bound of a tensor.
    [[nodiscard]] uint32_t corner(const Tensor& tensor, const Phase& phase) const;
    [[nodiscard]] uint32_t groups() const { return (desc_.out_channels + block_ - 1) / block_; }
    /// Bytes from the start of bias_ to its zeros, for slices that must not add the bias again.
    [[nodiscard]] uint64_t zeros_offset() const {
        return (uint64_t{groups()} * block_ * 4 + kBindingAlignment - 1) / kBindingAlignment *
               kBindingAlignment;
    }
    [[nodiscard]] uint32_t step() const { return desc_.transposed ? 2 : 1; }
    /// Of the matrices' kernel: matrices of output channels that a subgroup computes.
    [[nodiscard]] uint32_t matrices_across() const;

    Device& device_;
    ConvDesc desc_;
    std::vector<ChannelMap> inputs_;
    uint32_t in_channels_ = 0;
    ConvFamily family_;
    uint32_t block_;
    Precision precision_;
    bool matrices_ = false; ///< tile: by shaders/conv_matrix.glsl
    std::vector<Phase> phases_;
    std::vector<std::vector<Slice>> slices_;          ///< lane: by phase
    std::vector<RowSlice> row_slices_;                ///< row
    std::vector<std::vector<uint64_t>> tile_offsets_; ///< tile: by phase and input, bytes
    std::shared_ptr<const Buffer> weights_;
    std::shared_ptr<const Buffer> bias_; ///< [groups][block], at zeros_offset() as many zeros
};

} // namespace ecir
