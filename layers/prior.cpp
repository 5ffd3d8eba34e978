#include "layers/prior.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

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

/// What the kernels take for granted.
namespace shader {
using uint = uint32_t;
#include "shaders/fusion_constants.glsl"
static_assert(ANCHORS == anchor_count && GAPS == anchor_count - 1);
static_assert(WINDOWS == prior_windows && WINDOWS == GAPS * WINDOWS_AN_ANCHOR);
static_assert(offsetof(Instant, time) == size_t{4} * INSTANT_TIME &&
              offsetof(Instant, place) == size_t{4} * INSTANT_PLACE &&
              offsetof(Instant, below) == size_t{4} * INSTANT_BELOW &&
              offsetof(Instant, rank) == size_t{4} * INSTANT_RANKS);
static_assert(PLANE_SURFACES == PLANE_DIFFERENCES + ANCHORS && PLANE_TIME + 1 == plane_count);
} // namespace shader

bool fits(const PriorInput& input) {
    const Layout& blurry = input.blurry.layout();
    const uint64_t pixels = uint64_t{blurry.width} * blurry.height;
    const uint32_t events = input.marks.layout().width;
    return blurry.channels == 1 && input.offsets.layout().elements() == pixels + 1 &&
           input.times.layout().width == events && input.positives.layout().width == events + 1 &&
           input.thresholds.layout().elements() == 2;
}

} // namespace

size_t prior_busy_pixels(const EventView& events, uint32_t width, uint32_t height) {
    return static_cast<size_t>(
        std::ranges::count_if(event_counts(events, width, height),
                              [](uint32_t count) { return count > prior_busy_events; }));
}

void record_prior(Program& program, const PriorInput& input, const PriorExposure& exposure) {
    const uint32_t height = input.blurry.layout().height;
    const uint32_t width = input.blurry.layout().width;
    const uint32_t half_height = (height + 1) / 2;
    const uint32_t half_width = (width + 1) / 2;
    require_shapes(fits(input) && has_shape(exposure.anchors, anchor_count, height, width) &&
                       has_shape(exposure.context, anchor_count, height, width) &&
                       has_shape(exposure.base, 1, height, width) &&
                       has_shape(exposure.logarithms, prior_windows + 1, half_height, half_width),
                   "prior",
                   {input.offsets, input.times, input.marks, input.positives, input.blurry,
                    input.thresholds, exposure.anchors, exposure.context, exposure.base,
                    exposure.logarithms});
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
    require_shapes(fits(input) &&
                       has_shape(planes, plane_count, input.blurry.layout().height,
                                 input.blurry.layout().width) &&
                       has_shape(base, 1, layout.height, layout.width) && is_instant(instant),
                   "prior frame",
                   {input.offsets, input.times, input.marks, input.positives, input.blurry,
                    input.thresholds, base, instant, planes});
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("prior_frame", kConstants, 9, sizeof(FramePush));
    dispatch.arguments = {
        read(input.offsets), read(input.times),      read(input.marks), read(input.positives),
        read(input.blurry),  read(input.thresholds), read(base),        read(instant),
        update(planes)};
    dispatch.set_push(FramePush{PushLayout(input.blurry), PushLayout(base), PushLayout(planes),
                                origin(instant), layout.width});
    dispatch.groups = pixel_groups(layout);
    const double pixels = double{1} * layout.width * layout.height;
    dispatch.flops = 60 * pixels;
    dispatch.bytes = 4 * 24 * pixels;
    dispatch.label = "prior_frame";
    program.add(std::move(dispatch));
}

} // namespace ecir
