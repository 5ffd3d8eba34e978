#include "layers/prior.hpp"

#include <array>
#include <string>

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/prior.comp.
struct Push {
    PushLayout blurry;
    PushLayout anchors;
    PushLayout context;
    PushLayout base;
    PushLayout logarithms;
    uint32_t width = 0;
    uint32_t height = 0;
};
static_assert(sizeof(Push) == 88);

/// Mirrors the push constants of shaders/prior_frame.comp.
struct FramePush {
    PushLayout blurry;
    PushLayout base;
    PushLayout planes;
    uint32_t instant_origin = 0;
    uint32_t width = 0;
};
static_assert(sizeof(FramePush) == 56);

constexpr std::array<uint32_t, 1> kConstants = {prior_busy_events};

bool has_shape(const Tensor& tensor, uint32_t channels, uint32_t height, uint32_t width) {
    const Layout& layout = tensor.layout();
    return layout.channels == channels && layout.height == height && layout.width == width;
}

void check(const PriorInput& input, bool outputs) {
    const Layout& blurry = input.blurry.layout();
    const uint64_t pixels = uint64_t{blurry.width} * blurry.height;
    const uint32_t events = input.marks.layout().width;
    if (!outputs || blurry.channels != 1 || input.offsets.layout().elements() != pixels + 1 ||
        input.times.layout().width != events || input.positives.layout().width != events + 1 ||
        input.thresholds.layout().elements() != 2) {
        throw Error(ExitCode::bad_input,
                    "prior: " + std::to_string(input.offsets.layout().elements()) +
                        " event offsets and the outputs do not match a " +
                        std::to_string(blurry.width) + "x" + std::to_string(blurry.height) +
                        " image");
    }
}

} // namespace

void record_prior(Program& program, const PriorInput& input, const PriorExposure& exposure) {
    const auto [channels, height, width, block, halo, pitch] = input.blurry.layout();
    const uint32_t half_height = (height + 1) / 2;
    const uint32_t half_width = (width + 1) / 2;
    check(input, has_shape(exposure.anchors, anchor_count, height, width) &&
                     has_shape(exposure.context, anchor_count, height, width) &&
                     has_shape(exposure.base, 1, height, width) &&
                     has_shape(exposure.logarithms, prior_windows + 1, half_height, half_width));
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("prior", kConstants, 9, sizeof(Push));
    dispatch.arguments = {
        read(input.offsets),      read(input.times),      read(input.marks),
        read(input.blurry),       read(input.thresholds), update(exposure.anchors),
        update(exposure.context), write(exposure.base),   write(exposure.logarithms)};
    dispatch.set_push(Push{PushLayout(input.blurry), PushLayout(exposure.anchors),
                           PushLayout(exposure.context), PushLayout(exposure.base),
                           PushLayout(exposure.logarithms), width, height});
    dispatch.groups = pixel_groups(exposure.logarithms.layout());
    const auto events = static_cast<double>(input.marks.layout().elements());
    const double pixels = double{1} * width * height;
    dispatch.flops = 15 * events + 15 * (prior_windows + 1) * pixels;
    dispatch.bytes = 16 * events + 4 * pixels * (2 * anchor_count + 2 + 0.25 * prior_windows);
    dispatch.label = "prior";
    program.add(std::move(dispatch));
}

void record_prior_frame(Program& program, const PriorInput& input, const Tensor& base,
                        const Tensor& instant, const Tensor& planes) {
    const Layout& layout = planes.layout();
    check(input, has_shape(planes, plane_count, input.blurry.layout().height,
                           input.blurry.layout().width) &&
                     has_shape(base, 1, layout.height, layout.width) &&
                     instant.layout().elements() == instant_layout(1).elements());
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("prior_frame", kConstants, 9, sizeof(FramePush));
    dispatch.arguments = {
        read(input.offsets), read(input.times),      read(input.marks), read(input.positives),
        read(input.blurry),  read(input.thresholds), read(base),        read(instant),
        update(planes)};
    dispatch.set_push(FramePush{PushLayout(input.blurry), PushLayout(base), PushLayout(planes),
                                PushLayout(instant).origin, layout.width});
    dispatch.groups = pixel_groups(layout);
    const double pixels = double{1} * layout.width * layout.height;
    dispatch.flops = 60 * pixels;
    dispatch.bytes = 4 * 24 * pixels;
    dispatch.label = "prior_frame";
    program.add(std::move(dispatch));
}

} // namespace ecir
