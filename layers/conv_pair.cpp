#include "layers/conv_pair.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <string>

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

constexpr uint32_t kTaps = 9;
constexpr uint32_t kTogether = 4; ///< CB of the shader: hidden channels at a time
/// Multiply-adds of a workgroup: code that the instruction caches can feed.
constexpr uint32_t kMostTaps = 2880;

/// Mirrors the push constants of shaders/conv_pair.comp.
struct PairPush {
    uint64_t in_address = 0;
    uint64_t weight_address = 0;
    uint64_t start_address = 0;
    uint64_t planes_address = 0;
    uint32_t in_row = 0;
    uint32_t in_plane = 0;
    uint32_t start_row = 0;
    uint32_t start_plane = 0;
    uint32_t planes_origin = 0;
    uint32_t planes_row = 0;
    uint32_t planes_plane = 0;
    uint32_t width = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(PairPush) == 96);

/// Mirrors the push constants of shaders/plane_sum.comp.
struct SumPush {
    uint64_t planes_address = 0;
    uint64_t added_address = 0;
    uint32_t planes_origin = 0;
    uint32_t planes_row = 0;
    uint32_t planes_plane = 0;
    uint32_t added_row = 0;
    uint32_t out_origin = 0;
    uint32_t out_row = 0;
    uint32_t width = 0;
    float bias = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(SumPush) == 80);

uint32_t lanes(const Device& device) {
    return device.info().subgroup_size;
}

uint32_t row(const Tensor& tensor) {
    return static_cast<uint32_t>(tensor.layout().row_stride());
}

uint32_t plane(const Tensor& tensor) {
    return static_cast<uint32_t>(tensor.layout().plane_stride());
}

/// Element (-1, -1) of channel 0 of a tensor of block 1.
uint64_t corner(const Tensor& tensor) {
    return tensor.layout().origin() - tensor.layout().row_stride() - 1;
}

bool has_block(const Tensor& tensor, uint32_t block) {
    return tensor.layout().block == block;
}

} // namespace

ConvPair::ConvPair(Device& device, uint32_t channels, uint32_t hidden, std::span<const float> first,
                   std::span<const float> second, float bias)
    : device_(device), channels_(channels), hidden_(hidden), bias_(bias) {
    if (first.size() != size_t{hidden} * channels * kTaps ||
        second.size() != size_t{hidden} * kTaps) {
        throw Error(ExitCode::device, "conv pair: weights of " + std::to_string(first.size()) +
                                          " and " + std::to_string(second.size()) +
                                          " values do not fit " + std::to_string(channels) +
                                          " -> " + std::to_string(hidden) + " -> 1 channels");
    }
    if (conv_family(device.info()) == ConvFamily::lane && channels <= kMostInputs) {
        pack(first, second);
    } else {
        whole_.emplace(
            Whole{Conv(device, {.out_channels = hidden, .relu = true}, {channel_range(0, channels)},
                       first, {}),
                  ConvPlane(device, hidden, 3, second, bias, conv_family(device.info()))});
    }
}

void ConvPair::pack(std::span<const float> first, std::span<const float> second) {
    const uint32_t each = channels_ * kTaps + kTaps; // weights of a hidden channel
    const uint32_t most = std::max(kTogether, kMostTaps / each / kTogether * kTogether);
    const uint32_t padded = round_up(hidden_, kTogether);
    std::vector<float> all(size_t{padded} * each);
    for (uint32_t o = 0; o < hidden_; ++o) {
        const size_t group = size_t{o / kTogether} * kTogether * each;
        const uint32_t c = o % kTogether;
        const size_t taps = size_t{channels_} * kTaps;
        for (size_t n = 0; n < taps; ++n) {
            all[group + n * kTogether + c] = first[o * taps + n];
        }
        for (size_t k = 0; k < kTaps; ++k) {
            all[group + taps * kTogether + size_t{c} * kTaps + k] = second[size_t{o} * kTaps + k];
        }
    }
    for (uint32_t o = 0; o < padded; o += most) {
        slices_.push_back({o, std::min(most, padded - o), uint64_t{o} * each * sizeof(float)});
    }
    weights_ = upload<float>(device_, all);
}

Tensor ConvPair::scratch(Program& program, uint32_t hidden, uint32_t height, uint32_t width) {
    const DeviceInfo& info = program.device().info();
    if (conv_family(info) != ConvFamily::lane) {
        return program.temporary({hidden, height, width, channel_block(info), 0});
    }
    Layout layout{kTaps, height, width, 1, 1};
    layout.pitch = ceil_div(width, lanes(program.device())) * lanes(program.device()) + 2;
    // The kernel writes the zeros right of the image, none else.
    return program.cleared(layout);
}

void ConvPair::check(const Tensor& input, const Tensor& scratch, const Tensor& output,
                     const Terms& terms) const {
    const uint32_t height = output.layout().height;
    const uint32_t width = output.layout().width;
    const auto good = [&](const Tensor& tensor, uint32_t channels, uint32_t block) {
        return has_shape(tensor, channels, height, width) && has_block(tensor, block);
    };
    if (!good(input, channels_, 1) || input.layout().halo < 1 || !good(output, 1, 1) ||
        (!whole_ && !good(scratch, kTaps, 1)) ||
        (terms.start && !good(*terms.start, hidden_, channel_block(device_.info())) &&
         !good(*terms.start, hidden_, 1)) ||
        (terms.added && !good(*terms.added, 1, 1))) {
        throw Error(ExitCode::device, "conv pair: input " + shape_text(input) +
                                          " or what is added does not fit output " +
                                          shape_text(output));
    }
}

void ConvPair::record(Program& program, const Tensor& input, const Tensor& scratch,
                      const Tensor& output, const Terms& terms) const {
    check(input, scratch, output, terms);
    if (whole_) { // of the lane family with many channels the scratch is of another kind
        const Layout layout{hidden_, output.layout().height, output.layout().width,
                            channel_block(device_.info()), 0};
        const bool fits =
            has_block(scratch, layout.block) && scratch.layout().channels >= hidden_ &&
            has_shape(scratch.channels(0, hidden_), hidden_, layout.height, layout.width);
        const Tensor between = fits ? scratch.channels(0, hidden_) : program.temporary(layout);
        whole_->expand.record(program, input, between, terms.start);
        whole_->project.record(program, between, output, terms.added);
        return;
    }
    record_fused(program, input, scratch, terms.start);
    record_sum(program, scratch, output, terms.added);
}

void ConvPair::record_fused(Program& program, const Tensor& input, const Tensor& planes,
                            const std::optional<Tensor>& start) const {
    const uint32_t height = planes.layout().height;
    const uint32_t width = planes.layout().width;
    const double pixels = double{1} * height * width;
    for (const Slice& slice : slices_) {
        const bool accumulate = slice.first > 0;
        const uint32_t block = start ? start->layout().block : 0;
        const uint32_t skip = start ? slice.first % block : 0;
        const std::array<uint32_t, 6> constants{lanes(device_), channels_, slice.count,
                                                block,          skip,      accumulate ? 1U : 0};
        PairPush push;
        push.in_row = row(input);
        push.in_plane = plane(input);
        push.planes_origin = PushLayout(planes).origin;
        push.planes_row = row(planes);
        push.planes_plane = plane(planes);
        push.width = width;
        Dispatch dispatch;
        dispatch.kernel = &device_.kernel("conv_pair", constants, 1, sizeof(push));
        dispatch.arguments = {update(planes)};
        dispatch.pointers = {
            {offsetof(PairPush, in_address), read(input), corner(input) * 4},
            {offsetof(PairPush, weight_address), constant(weights_, slice.offset), 0}};
        if (accumulate) {
            dispatch.pointers.push_back(
                {offsetof(PairPush, planes_address), read(planes), planes.layout().origin() * 4});
        }
        if (start) {
            const uint64_t first = start->layout().offset(slice.first - skip, 0, 0);
            push.start_row = row(*start);
            push.start_plane = plane(*start);
            dispatch.pointers.push_back(
                {offsetof(PairPush, start_address), read(*start), first * 4});
        }
        dispatch.set_push(push);
        dispatch.groups = {ceil_div(width, lanes(device_)), height, 1};
        const double real = std::min(slice.count, hidden_ - slice.first);
        dispatch.flops = 2.0 * pixels * real * (channels_ * kTaps + kTaps);
        dispatch.bytes =
            4.0 * pixels * (channels_ + kTaps * (accumulate ? 2 : 1) + (start ? real : 0));
        dispatch.label = "conv_pair";
        program.add(std::move(dispatch));
    }
}

void ConvPair::record_sum(Program& program, const Tensor& planes, const Tensor& output,
                          const std::optional<Tensor>& added) const {
    const uint32_t height = output.layout().height;
    const uint32_t width = output.layout().width;
    const RowTiles tiles(width, lanes(device_));
    const std::array<uint32_t, 3> constants{lanes(device_), tiles.vectors, added ? 1U : 0};
    SumPush push;
    push.planes_origin = static_cast<uint32_t>(corner(planes));
    push.planes_row = row(planes);
    push.planes_plane = plane(planes);
    push.out_origin = PushLayout(output).origin;
    push.out_row = row(output);
    push.width = width;
    push.bias = bias_;
    Dispatch dispatch;
    dispatch.kernel = &device_.kernel("plane_sum", constants, 1, sizeof(push));
    dispatch.arguments = {update(output)};
    dispatch.pointers = {{offsetof(SumPush, planes_address), read(planes), 0}};
    if (added) {
        push.added_row = row(*added);
        dispatch.pointers.push_back(
            {offsetof(SumPush, added_address), read(*added), added->layout().origin() * 4});
    }
    dispatch.set_push(push);
    dispatch.groups = {tiles.count, height, 1};
    const double pixels = double{1} * height * width;
    dispatch.flops = pixels * kTaps;
    dispatch.bytes = 4.0 * pixels * (kTaps + (added ? 2 : 1));
    dispatch.label = "plane_sum";
    program.add(std::move(dispatch));
}

} // namespace ecir
