#include "layers/refine.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "layers/conv.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/refine_state.comp.
struct StatePush {
    PushLayout frames;
    PushLayout counts;
    PushLayout state;
    uint32_t width = 0;
    uint32_t intervals = 0; ///< whose counts are written; 0: none
};
static_assert(sizeof(StatePush) == 56);

/// Mirrors the push constants of shaders/refine_state_lane.comp.
struct StateLanePush {
    uint64_t frames_address = 0;
    uint32_t frames_row = 0;
    uint32_t frames_plane = 0;
    uint32_t state_origin = 0;
    uint32_t state_row = 0;
    uint32_t state_plane = 0;
    uint32_t width = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(StateLanePush) == 64);

/// Mirrors the end of the push constants of shaders/refine_update*.comp.
struct UpdateSizes {
    uint32_t row;
    uint32_t plane;
    uint32_t width;
    uint32_t first; ///< frame at which the origins and addresses point
    uint32_t last;  ///< d - 1
    AlphaWeights alpha;
    float largest_step;
};
struct UpdatePush {
    uint32_t initial_origin;
    uint32_t state_origin;
    uint32_t updated_origin;
    uint32_t largest_origin;
    UpdateSizes sizes;
};
static_assert(sizeof(UpdatePush) == 80);
struct UpdateLanePush {
    uint64_t initial_address = 0;
    uint64_t state_address = 0;
    uint32_t updated_origin = 0;
    uint32_t largest_origin = 0;
    UpdateSizes sizes{};
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(UpdateLanePush) == 120);

/// Mirrors the push constants of shaders/refine_settled.comp.
struct SettledPush {
    uint32_t largest_origin;
    uint32_t before_origin;
    uint32_t moving_origin;
    float least;
    uint32_t falling;
};
static_assert(sizeof(SettledPush) == 20);

/// Groups of `most` frames at most whose views the device can bind: those of the state are the
/// largest. A group reads the state of `beside` more frames.
std::vector<ChannelGroup> frame_groups(const DeviceInfo& device, const Tensor& state,
                                       uint32_t beside, uint32_t most) {
    Layout frames = state.layout();
    frames.channels /= refine_planes;
    frames.pitch = frames.row_pixels() * refine_planes;
    std::vector<ChannelGroup> groups;
    for (const auto& [first, count] : channel_groups(device, frames, 1, beside)) {
        for (uint32_t done = 0; done < count; done += std::min(most, count - done)) {
            groups.push_back({first + done, std::min(most, count - done)});
        }
    }
    return groups;
}

/// Planes of the frames first, ..., end - 1 in the state.
Tensor state_view(const Tensor& state, uint32_t first, uint32_t end) {
    return state.channels(refine_planes * first, refine_planes * (end - first));
}

} // namespace

float largest_refine_step(uint32_t frames) {
    return static_cast<float>(1 / (3 + 2 * std::cos(std::numbers::pi / frames)));
}

void record_refine_state(Program& program, const Tensor& frames, const Tensor* counts,
                         const Tensor& state, uint32_t together) {
    const Layout& layout = frames.layout();
    const uint32_t d = layout.channels;
    const bool counted = counts != nullptr && d > 1;
    bool good = layout.block == 1 && state.layout().block == 1 &&
                has_shape(state, refine_planes * d, layout.height, layout.width);
    if (counted) {
        good = good && counts->layout().block == 1 &&
               has_shape(*counts, 2 * (d - 1), layout.height, layout.width);
    }
    require_shapes(good, "refinement", {frames, counted ? *counts : frames, state});
    const DeviceInfo& device = program.device().info();
    const bool lane = conv_family(device) == ConvFamily::lane && !counted && layout.halo > 0;
    for (const auto& [first, count] : frame_groups(device, state, 1, together)) {
        const Tensor from = frames.channels(first, count);
        const Tensor to = state_view(state, first, first + count);
        const uint32_t intervals = counted ? std::min(count, d - 1 - first) : 0;
        const Tensor events = intervals > 0 ? counts->channels(2 * first, 2 * intervals) : from;
        Dispatch dispatch;
        if (lane) {
            const RowTiles tiles(layout.width, device.subgroup_size);
            const std::array<uint32_t, 2> constants{device.subgroup_size, tiles.vectors};
            StateLanePush push;
            push.frames_row = static_cast<uint32_t>(layout.row_stride());
            push.frames_plane = static_cast<uint32_t>(layout.plane_stride());
            push.state_origin = PushLayout(to).origin;
            push.state_row = static_cast<uint32_t>(to.layout().row_stride());
            push.state_plane = static_cast<uint32_t>(to.layout().plane_stride());
            push.width = layout.width;
            dispatch.kernel =
                &program.device().kernel("refine_state_lane", constants, 1, sizeof(StateLanePush));
            dispatch.arguments = {update(to)};
            dispatch.pointers = {
                {offsetof(StateLanePush, frames_address), read(from), layout.origin() * 4}};
            dispatch.set_push(push);
            dispatch.groups = {tiles.count, layout.height, count};
        } else {
            dispatch.kernel = &program.device().kernel("refine_state", {}, 3, sizeof(StatePush));
            dispatch.arguments = {read(from), read(events), update(to)};
            dispatch.set_push(StatePush{PushLayout(from), PushLayout(events), PushLayout(to),
                                        layout.width, intervals});
            dispatch.groups = pixel_groups(layout, count);
        }
        const double pixels = static_cast<double>(layout.width) * layout.height;
        dispatch.flops = 2 * pixels * count;
        dispatch.bytes = 4 * pixels * (4 * count + 4 * intervals);
        dispatch.label = "refine_state";
        program.add(std::move(dispatch));
    }
}

void record_refine_update(Program& program, const Tensor& initial, const Tensor& state,
                          const AlphaWeights& alpha, const Tensor& updated, const Tensor& largest,
                          float largest_step, uint32_t together) {
    const Layout& layout = updated.layout();
    const uint32_t d = layout.channels;
    const auto alike = [&](const Tensor& tensor, uint32_t channels) {
        const Layout& other = tensor.layout();
        return has_shape(tensor, channels, layout.height, layout.width) && other.block == 1 &&
               other.halo == 1 && other.row_stride() == layout.row_stride();
    };
    require_shapes(alike(initial, d) && alike(updated, d) && alike(state, refine_planes * d),
                   "refinement", {initial, state, updated});
    const DeviceInfo& device = program.device().info();
    const bool lane = conv_family(device) == ConvFamily::lane;
    for (const auto& [first, count] : frame_groups(device, state, 2, together)) {
        const uint32_t begin = first > 0 ? first - 1 : 0;
        const uint32_t end = std::min(first + count + 1, d);
        const uint64_t skip = uint64_t{refine_planes} * (first - begin) * layout.plane_stride();
        const Tensor starts = initial.channels(first, count);
        const Tensor around = state_view(state, begin, end);
        const Tensor results = updated.channels(first, count);
        const uint32_t result_origin = PushLayout(results).origin;
        const uint32_t largest_origin = PushLayout(largest).origin;
        const UpdateSizes sizes{static_cast<uint32_t>(layout.row_stride()),
                                static_cast<uint32_t>(layout.plane_stride()),
                                layout.width,
                                first,
                                d - 1,
                                alpha,
                                largest_step};
        Dispatch dispatch;
        if (lane) {
            const RowTiles tiles(layout.width, device.subgroup_size);
            const std::array<uint32_t, 2> constants{device.subgroup_size, tiles.vectors};
            dispatch.kernel = &program.device().kernel("refine_update_lane", constants, 2,
                                                       sizeof(UpdateLanePush));
            dispatch.arguments = {update(results), update(largest)};
            const uint64_t origin = layout.origin() * 4;
            dispatch.pointers = {
                {offsetof(UpdateLanePush, initial_address), read(starts), origin},
                {offsetof(UpdateLanePush, state_address), read(around), origin + skip * 4}};
            UpdateLanePush push;
            push.updated_origin = result_origin;
            push.largest_origin = largest_origin;
            push.sizes = sizes;
            dispatch.set_push(push);
            dispatch.groups = {tiles.count, layout.height, count};
        } else {
            dispatch.kernel = &program.device().kernel("refine_update", {}, 4, sizeof(UpdatePush));
            dispatch.arguments = {read(starts), read(around), update(results), update(largest)};
            dispatch.set_push(UpdatePush{PushLayout(starts).origin,
                                         PushLayout(around).origin + static_cast<uint32_t>(skip),
                                         result_origin, largest_origin, sizes});
            dispatch.groups = pixel_groups(layout, count);
        }
        const double values = static_cast<double>(layout.width) * layout.height * count;
        dispatch.flops = 32 * values;
        dispatch.bytes = 16 * values;
        dispatch.label = "refine_update";
        program.add(std::move(dispatch));
    }
}

void record_refine_settled(Program& program, const Tensor& largest, float least,
                           const std::optional<Tensor>& before, const Tensor& moving) {
    Dispatch dispatch;
    const Tensor& other = before ? *before : largest;
    dispatch.kernel = &program.device().kernel("refine_settled", {}, 3, sizeof(SettledPush));
    dispatch.arguments = {read(largest), read(other), write(moving)};
    dispatch.set_push(SettledPush{PushLayout(largest).origin, PushLayout(other).origin,
                                  PushLayout(moving).origin, least, before ? 1U : 0U});
    dispatch.label = "refine_settled";
    program.add(std::move(dispatch));
}

} // namespace ecir
