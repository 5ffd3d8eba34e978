#include "layers/conv_plane.hpp"

#include "layers/shapes.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

struct TapSumPush {
    PushLayout taps;
    PushLayout added;
    PushLayout out;
    uint32_t height = 0;
    uint32_t width = 0;
    uint32_t kernel = 0;
    uint32_t has_added = 0;
};
static_assert(sizeof(TapSumPush) == 64);

/// [1][channels][k][k] as the 1x1 weight [planes][channels].
std::vector<float> tap_major(std::span<const float> weight, uint32_t channels, uint32_t planes) {
    std::vector<float> result(size_t{planes} * channels);
    const size_t taps = weight.size() / channels;
    for (size_t i = 0; i < weight.size(); ++i) {
        result[i % taps * channels + i / taps] = weight[i];
    }
    return result;
}

/// The bias as that of the middle tap, which always lies in the image.
std::vector<float> middle_bias(float bias, uint32_t taps, uint32_t planes) {
    std::vector<float> result(planes);
    result[taps / 2] = bias;
    return result;
}

} // namespace

ConvPlane::ConvPlane(Device& device, uint32_t channels, uint32_t kernel,
                     std::span<const float> weight, float bias, ConvFamily family)
    : device_(device), kernel_(kernel), family_(family),
      planes_(round_up(kernel * kernel, kConvRowGroup)),
      taps_(device, {.out_channels = planes_, .kernel = 1}, {channel_range(0, channels)},
            tap_major(weight, channels, planes_), middle_bias(bias, kernel * kernel, planes_),
            family) {}

void ConvPlane::record(Program& program, const Tensor& input, const Tensor& output,
                       const std::optional<Tensor>& added) const {
    const Layout& out = output.layout();
    if (added && (added->layout().channels != 1 || added->layout().height != out.height ||
                  added->layout().width != out.width)) {
        throw Error(ExitCode::device, "conv: what is added and the output differ in shape");
    }
    const Tensor planes =
        program.temporary(conv_layout(device_.info(), family_, planes_, out.height, out.width));
    taps_.record(program, input, planes);

    TapSumPush push;
    push.taps = PushLayout(planes);
    push.added = PushLayout(added.value_or(planes));
    push.out = PushLayout(output);
    push.height = out.height;
    push.width = out.width;
    push.kernel = kernel_;
    push.has_added = added ? 1 : 0;
    Dispatch dispatch;
    dispatch.kernel = &device_.kernel("tap_sum", {}, 3, sizeof(push));
    dispatch.arguments = {read(planes), read(added.value_or(planes)), write(output)};
    dispatch.set_push(push);
    dispatch.groups = {(out.width + 63) / 64, out.height, 1};
    const double pixels = double{1} * out.height * out.width;
    dispatch.flops = pixels * kernel_ * kernel_;
    dispatch.bytes = 4.0 * pixels * (kernel_ * kernel_ + 1);
    dispatch.label = "tap_sum";
    program.add(std::move(dispatch));
}

} // namespace ecir
