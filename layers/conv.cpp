#include "layers/conv.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>

#include "layers/shapes.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

struct LanePush {
    uint64_t in_address = 0;
    uint32_t in_row = 0;
    uint32_t in_plane = 0;
    uint32_t out_origin = 0;
    uint32_t out_row = 0;
    uint32_t out_plane = 0;
    uint32_t bias_origin = 0;
    uint32_t init_origin = 0;
    uint32_t init_pixel = 0;
    uint32_t init_row = 0;
    uint32_t init_plane = 0;
    uint32_t width = 0;
    float floor = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(LanePush) == 88);

[[noreturn]] void fail(const std::string& what) {
    throw Error(ExitCode::device, "conv: " + what);
}

/// Pixels of a lane: the larger the tile the faster, the smaller the less is wasted at the end of a
/// row.
uint32_t lane_pixels(uint32_t width) {
    constexpr uint32_t kTileOverhead = 12; // in pixels: the rest of what a tile costs
    uint32_t best = 40;
    for (const uint32_t pixels : {40U, 30U, 20U, 15U}) {
        if (ceil_div(width, pixels) * (pixels + kTileOverhead) <
            ceil_div(width, best) * (best + kTileOverhead)) {
            best = pixels;
        }
    }
    return best;
}

/// Of the most that convolutions of the networks take with K = 16, 24 KiB, and what is to spare.
constexpr uint32_t kMatrixSharedBytes = 32768;

/// Kernels that the environment asks for.
std::string_view wanted() {
    const char* value = std::getenv("ECIR_CONV");
    return value != nullptr ? value : "";
}

std::string explain_float16(const DeviceInfo& info) {
    if (!has_float16(info)) {
        return "no, the device lacks it";
    }
    const Matrices& matrices = info.matrices;
    if (matrices.form == Matrices::Form::none) {
        return "yes, by conv_tile_half.comp: no cooperative matrices that this build knows";
    }
    const std::string shape = std::to_string(matrices.m) + "x" + std::to_string(matrices.n) + "x" +
                              std::to_string(matrices.k) + " (" +
                              std::string(form_name(matrices.form)) + ")";
    if (!use_matrices(info, matrices.n)) {
        return "yes, by conv_tile_half.comp: ECIR_CONV=tile, or too little shared memory or "
               "workgroups too small for cooperative matrices " +
               shape;
    }
    return "yes, by cooperative matrices " + shape + " (shaders/conv_matrix.glsl) from " +
           std::to_string(matrices.n) + " output channels on, below by conv_tile_half.comp";
}

} // namespace

ConvFamily conv_family(const DeviceInfo& info) {
    const bool lane =
        info.is_cpu && info.buffer_address && info.max_uniform_range >= kConvUniformSlice;
    return lane && wanted() != "tile" && wanted() != "matrix" ? ConvFamily::lane : ConvFamily::tile;
}

uint32_t images_at_once(const DeviceInfo& info, uint32_t height, uint32_t width) {
    constexpr uint64_t kPixels = 1U << 19;
    if (conv_family(info) == ConvFamily::lane) {
        return 1;
    }
    return static_cast<uint32_t>(std::clamp<uint64_t>(kPixels / (uint64_t{height} * width), 1, 16));
}

bool use_matrices(const DeviceInfo& info, uint32_t out_channels) {
    return info.matrices.form != Matrices::Form::none && wanted() != "tile" &&
           info.max_shared_bytes >= kMatrixSharedBytes &&
           info.max_invocations >= conv_tile_lines * info.subgroup_size &&
           out_channels >= info.matrices.n;
}

void check_precision(const DeviceInfo& info, Precision precision) {
    if (precision == Precision::float32) {
        return;
    }
    if (!has_float16(info)) {
        throw Error(ExitCode::usage, info.name + " has no " +
                                         (info.float16 ? "16-bit storage" : "float16 arithmetic") +
                                         "; leave --precision out");
    }
    if (conv_family(info) != ConvFamily::tile) {
        throw Error(ExitCode::usage,
                    "only the convolution kernels of GPUs know float16, not those for CPU drivers "
                    "that " +
                        info.name +
                        " gets; leave --precision out, or set ECIR_CONV=tile to try them");
    }
}

std::string explain_convolutions(const DeviceInfo& info) {
    const auto yes = [](bool value) { return value ? "yes" : "no"; };
    std::string text = "CPU driver: " + std::string(yes(info.is_cpu)) +
                       "; buffer addresses: " + yes(info.buffer_address) +
                       "; uniform range: " + std::to_string(info.max_uniform_range) + " bytes of " +
                       std::to_string(kConvUniformSlice) + " needed; ECIR_CONV: " +
                       std::string(wanted().empty() ? "not set" : wanted()) + "\n";
    if (conv_family(info) == ConvFamily::tile) {
        text += "tile (shaders/conv_tile.comp) for all convolutions: input and weights of 4 "
                "channels in shared memory, up to 8 pixels x 8 output channels an invocation; for "
                "GPUs, and wherever the families for CPU drivers cannot run or ECIR_CONV=tile asks "
                "for it\n";
        return text + "--precision float16: " + explain_float16(info) + "\n";
    }
    return text + "row (shaders/conv_row.comp, conv_row_up.comp), a lane a pixel, with " +
           std::to_string(kConvRowLanes) + " lanes (here " + std::to_string(info.subgroup_size) +
           ") for networks whose channels are multiples of " + std::to_string(kConvRowGroup) +
           ": 0.4 to 0.85 of lane's time at their shapes\n"
           "lane (shaders/conv_lane.comp), a lane an output channel in blocks of " +
           std::to_string(channel_block(info)) +
           ", for other networks, and for `ecir` and eSL-Net where a tensor of the image's size is "
           "more than the device binds at once\n"
           "pair (shaders/conv_pair.comp) where a convolution, ReLU and a convolution to one "
           "channel "
           "follow each other: the values between stay in registers\n";
}

uint32_t channel_block(const DeviceInfo& info) {
    return conv_family(info) == ConvFamily::lane && info.subgroup_size == 16 ? 16 : kConvTileBlock;
}

ConvFamily row_family(const DeviceInfo& info, std::span<const uint32_t> out_channels) {
    const bool whole = std::ranges::all_of(
        out_channels, [](uint32_t channels) { return channels % kConvRowGroup == 0; });
    const ConvFamily family = conv_family(info);
    return family == ConvFamily::lane && whole && info.subgroup_size == kConvRowLanes
               ? ConvFamily::row
               : family;
}

ConvFamily row_family(const DeviceInfo& info, std::span<const uint32_t> out_channels,
                      uint64_t most) {
    const uint64_t bytes = most * sizeof(float) + kBindingAlignment;
    return bytes <= info.max_storage_range ? row_family(info, out_channels) : conv_family(info);
}

Layout conv_layout(const DeviceInfo& info, ConvFamily family, uint32_t channels, uint32_t height,
                   uint32_t width, uint32_t halo) {
    if (family != ConvFamily::row) {
        return {channels, height, width, channel_block(info), halo};
    }
    constexpr uint32_t kPitchStep = 8; // the same for a halo of 1 and of 2
    const uint32_t pitch = round_up(row_pixels(width) + 2 * halo, kPitchStep);
    return {channels, height, width, 1, halo, pitch, channels};
}

Layout image_layout(const DeviceInfo& info, ConvFamily family, uint32_t channels, uint32_t height,
                    uint32_t width, uint32_t halo) {
    return family == ConvFamily::row ? conv_layout(info, family, channels, height, width, halo)
                                     : Layout{channels, height, width, 1, halo};
}

ChannelMap channel_range(uint32_t first, uint32_t count) {
    ChannelMap map(count);
    for (uint32_t i = 0; i < count; ++i) {
        map[i] = first + i;
    }
    return map;
}

void Conv::check(std::span<const Tensor> inputs, const Tensor& output,
                 const std::optional<Tensor>& residual) const {
    if (inputs.size() != inputs_.size()) {
        fail("takes " + std::to_string(inputs_.size()) + " input tensors");
    }
    const Layout& out = output.layout();
    const uint32_t halo = desc_.transposed ? 1 : desc_.kernel / 2;
    for (size_t i = 0; i < inputs.size(); ++i) {
        const Layout& in = inputs[i].layout();
        const bool shape = desc_.transposed ? ceil_div(out.height, 2) == in.height &&
                                                  ceil_div(out.width, 2) == in.width
                                            : ceil_div(in.height, desc_.stride) == out.height &&
                                                  ceil_div(in.width, desc_.stride) == out.width;
        if (!shape || in.channels != inputs_[i].size() || in.halo < halo ||
            (family_ == ConvFamily::row ? in.row_channels == 0
                                        : in.block != block_ && in.block != 1)) {
            fail("input " + std::to_string(i) + " of " + std::to_string(in.channels) + "x" +
                 std::to_string(in.height) + "x" + std::to_string(in.width) +
                 " does not fit output " + std::to_string(out.channels) + "x" +
                 std::to_string(out.height) + "x" + std::to_string(out.width));
        }
    }
    if (out.channels != desc_.out_channels || out.block != block_) {
        fail("output has the wrong channels or block");
    }
    if (residual &&
        (residual->layout().channels != out.channels || residual->layout().height != out.height ||
         residual->layout().width != out.width ||
         (residual->layout().block != block_ && family_ != ConvFamily::row))) {
        fail("residual and output differ in shape");
    }
}

void Conv::record(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                  const std::optional<Tensor>& residual) const {
    check(inputs, output, residual);
    if (family_ == ConvFamily::lane) {
        record_lane(program, inputs, output, residual);
    } else if (family_ == ConvFamily::row) {
        record_row(program, inputs, output, residual);
    } else {
        record_tile(program, inputs, output, residual);
    }
}

uint32_t Conv::corner(const Tensor& tensor, const Phase& phase) const {
    return PushLayout(tensor).origin +
           static_cast<uint32_t>(phase.offset_y * tensor.layout().row_stride() +
                                 uint64_t{phase.offset_x} * block_);
}

void Conv::record_lane(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                       const std::optional<Tensor>& residual) const {
    const Layout& out = output.layout();
    const uint64_t zeros = zeros_offset();
    for (size_t p = 0; p < phases_.size(); ++p) {
        const Phase& phase = phases_[p];
        const uint32_t height = ceil_div(out.height - phase.offset_y, step());
        const uint32_t width = ceil_div(out.width - phase.offset_x, step());
        if (height == 0 || width == 0 || out.height <= phase.offset_y ||
            out.width <= phase.offset_x) {
            continue;
        }
        const uint32_t pixels = lane_pixels(width);
        const uint32_t stride = desc_.transposed ? 1 : desc_.stride;
        const auto& slices = slices_[p];
        for (size_t s = 0; s < slices.size(); ++s) {
            const Slice& slice = slices[s];
            const Tensor& source = inputs[slice.input];
            const Layout& in = source.layout();
            const bool accumulate = s > 0;
            const bool from_tensor = accumulate || residual.has_value();
            const std::array<uint32_t, 9> constants{
                block_, pixels,   slice.count, phase.kernel_h,      phase.kernel_w,
                stride, in.block, step(),      from_tensor ? 1U : 0};
            const uint64_t in_corner = in.origin() + slice.first / in.block * in.plane_stride() -
                                       phase.pad_y * in.row_stride() -
                                       uint64_t{phase.pad_x} * in.block;
            LanePush push;
            push.in_row = static_cast<uint32_t>(in.row_stride());
            push.in_plane = static_cast<uint32_t>(in.plane_stride());
            push.out_row = static_cast<uint32_t>(out.row_stride() * step());
            push.out_plane = static_cast<uint32_t>(out.plane_stride());
            push.width = width;
            push.floor =
                s + 1 == slices.size() && desc_.relu ? 0 : std::numeric_limits<float>::lowest();
            const Tensor& init = accumulate ? output : residual.value_or(output);
            if (from_tensor) {
                const Layout& start = init.layout();
                push.init_pixel = step() * block_;
                push.init_row = static_cast<uint32_t>(start.row_stride() * step());
                push.init_plane = static_cast<uint32_t>(start.plane_stride());
            }
            for (uint32_t chunk = 0; chunk < slice.offsets.size(); ++chunk) {
                const uint32_t group = chunk * slice.groups_per_chunk;
                const uint32_t count = std::min(slice.groups_per_chunk, groups() - group);
                const Tensor target = output.channels(group * block_, count * block_);
                push.out_origin = corner(target, phase);
                push.bias_origin = group * block_;
                Dispatch dispatch;
                dispatch.kernel = &device_.kernel("conv_lane", constants, 4, sizeof(push));
                dispatch.arguments = {constant(weights_, slice.offsets[chunk]),
                                      constant(bias_, accumulate ? zeros : 0),
                                      constant(bias_, zeros), update(target)};
                if (from_tensor) {
                    const Tensor start = init.channels(group * block_, count * block_);
                    push.init_origin = corner(start, phase);
                    dispatch.arguments[2] = ecir::read(start);
                }
                dispatch.pointers = {
                    {offsetof(LanePush, in_address), ecir::read(source), in_corner * 4}};
                dispatch.set_push(push);
                dispatch.groups = {ceil_div(width, pixels), height, count};
                const double outputs =
                    double{1} * width * height *

                    std::min(count * block_, desc_.out_channels - group * block_);
                const auto real = std::min<uint32_t>(
                    slice.count, static_cast<uint32_t>(inputs_[slice.input].size()) - slice.first);
                dispatch.flops = 2.0 * outputs * real * static_cast<double>(phase.taps.size());
                dispatch.bytes = 4.0 * (double{1} * in.height * in.width * real + 2 * outputs);
                dispatch.label = "conv_lane";
                program.add(std::move(dispatch));
            }
        }
    }
}

} // namespace ecir
