#include "layers/prior.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

#include "layers/conv.hpp"
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

/// Mirrors the push constants of shaders/prior_frame_row.comp.
struct RowPush {
    uint64_t state_address = 0;
    uint64_t offsets_address = 0;
    uint64_t times_address = 0;
    uint64_t marks_address = 0;
    uint64_t blurry_address = 0;
    uint64_t base_address = 0;
    uint64_t thresholds_address = 0;
    uint64_t instant_address = 0;
    uint32_t blurry_row = 0;
    uint32_t base_row = 0;
    uint32_t planes_origin = 0;
    uint32_t planes_row = 0;
    uint32_t planes_plane = 0;
    uint32_t state_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(RowPush) == 128);
static_assert(prior_busy_events < 1024); // counts of 11 bits

constexpr std::array<uint32_t, 1> kConstants = {prior_busy_events};

/// What the kernels take for granted.
namespace shader {
using uint = uint32_t;
#include "shaders/fusion_constants.glsl"
static_assert(ANCHORS == anchor_count && GAPS == anchor_count - 1);
static_assert(WINDOWS == prior_windows && WINDOWS == GAPS * WINDOWS_A_GAP);
static_assert(offsetof(Instant, time) == size_t{4} * INSTANT_TIME &&
              offsetof(Instant, place) == size_t{4} * INSTANT_PLACE &&
              offsetof(Instant, below) == size_t{4} * INSTANT_BELOW &&
              offsetof(Instant, rank) == size_t{4} * INSTANT_RANKS &&
              offsetof(Instant, share) == size_t{4} * INSTANT_SHARE);
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

uint32_t row(const Tensor& tensor) {
    return static_cast<uint32_t>(tensor.layout().row_stride());
}

Dispatch row_frame(Program& program, const PriorInput& input, const Tensor& base,
                   const Tensor& instant, const Tensor& state, const Tensor& planes) {
    constexpr uint32_t kMostVectors = 5;
    const Layout& layout = planes.layout();
    const uint32_t lanes = program.device().info().subgroup_size;
    const RowTiles tiles(layout.width, lanes, kMostVectors);
    const std::array<uint32_t, 3> constants{lanes, tiles.vectors, prior_busy_events};
    RowPush push;
    push.blurry_row = row(input.blurry);
    push.base_row = row(base);
    push.planes_origin = PushLayout(planes).origin;
    push.planes_row = row(planes);
    push.planes_plane = static_cast<uint32_t>(layout.plane_stride());
    push.state_origin = PushLayout(state).origin;
    push.width = layout.width;
    push.height = layout.height;
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("prior_frame_row", constants, 2, sizeof(push));
    dispatch.arguments = {update(planes), update(state)};
    dispatch.pointers = {
        {offsetof(RowPush, state_address), read(state), 0},
        {offsetof(RowPush, offsets_address), read(input.offsets), 0},
        {offsetof(RowPush, times_address), read(input.times), 0},
        {offsetof(RowPush, marks_address), read(input.marks), 0},
        {offsetof(RowPush, blurry_address), read(input.blurry), input.blurry.layout().origin() * 4},
        {offsetof(RowPush, base_address), read(base), base.layout().origin() * 4},
        {offsetof(RowPush, thresholds_address), read(input.thresholds), 0},
        {offsetof(RowPush, instant_address), read(instant), 0}};
    dispatch.set_push(push);
    dispatch.groups = {tiles.count, layout.height, 1};
    return dispatch;
}

Dispatch pixel_frame(Program& program, const PriorInput& input, const Tensor& base,
                     const Tensor& instant, const Tensor& planes) {
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("prior_frame", kConstants, 9, sizeof(FramePush));
    dispatch.arguments = {
        read(input.offsets), read(input.times),      read(input.marks), read(input.positives),
        read(input.blurry),  read(input.thresholds), read(base),        read(instant),
        update(planes)};
    dispatch.set_push(FramePush{PushLayout(input.blurry), PushLayout(base), PushLayout(planes),
                                origin(instant), planes.layout().width});
    dispatch.groups = pixel_groups(planes.layout());
    return dispatch;
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

Layout prior_state_layout(uint32_t height, uint32_t width) {
    return {3, height, width};
}

void record_prior_frame(Program& program, const PriorInput& input, const Tensor& base,
                        const Tensor& instant, const Tensor& state, const Tensor& planes) {
    const Layout& layout = planes.layout();
    const Layout places = prior_state_layout(layout.height, layout.width);
    require_shapes(fits(input) &&
                       has_shape(planes, plane_count, input.blurry.layout().height,
                                 input.blurry.layout().width) &&
                       has_shape(base, 1, layout.height, layout.width) && is_instant(instant) &&
                       has_shape(state, places.channels, places.height, places.width) &&
                       is_dense(state),
                   "prior frame",
                   {input.offsets, input.times, input.marks, input.positives, input.blurry,
                    input.thresholds, base, instant, state, planes});
    const bool rows = conv_family(program.device().info()) == ConvFamily::lane &&
                      layout.block == 1 && base.layout().block == 1 &&
                      input.blurry.layout().block == 1;
    Dispatch dispatch = rows ? row_frame(program, input, base, instant, state, planes)
                             : pixel_frame(program, input, base, instant, planes);
    const double pixels = double{1} * layout.width * layout.height;
    dispatch.flops = 60 * pixels;
    dispatch.bytes = 4 * 24 * pixels;
    dispatch.label = "prior_frame";
    program.add(std::move(dispatch));
}

} // namespace ecir
