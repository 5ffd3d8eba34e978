#include "layers/refine.hpp"

#include <algorithm>
#include <string>

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/refine_input.comp.
struct InputPush {
    PushLayout frames;
    PushLayout counts;
    PushLayout residuals;
    PushLayout result;
    uint32_t width;
    uint32_t height;
    uint32_t frame;    ///< channel of frame i in its view
    uint32_t count;    ///< channel of the positive events
    uint32_t residual; ///< channel of residual i - 1
    uint32_t first;    ///< 1: interval 0, without a residual before it
};
static_assert(sizeof(InputPush) == 88);

/// Mirrors the push constants of shaders/refine_update.comp.
struct UpdatePush {
    PushLayout initial;
    PushLayout frames;
    PushLayout residuals;
    PushLayout updated;
    uint32_t width;
    uint32_t height;
    uint32_t first; ///< frame that is channel 0 of the views of `initial` and `updated`
    uint32_t last;  ///< d - 1
    uint32_t skip;  ///< its channel in the views of `frames` and `residuals`
    AlphaWeights alpha;
};
static_assert(sizeof(UpdatePush) == 124);

std::string shape(const Tensor& tensor) {
    const Layout& layout = tensor.layout();
    return std::to_string(layout.channels) + "x" + std::to_string(layout.height) + "x" +
           std::to_string(layout.width);
}

void check(const char* what, const Tensor& tensor, uint32_t channels, const Tensor& like) {
    const Layout& layout = tensor.layout();
    if (layout.channels < channels || layout.height != like.layout().height ||
        layout.width != like.layout().width) {
        throw Error(ExitCode::bad_input, std::string("refinement: ") + what + " of " +
                                             shape(tensor) + " do not match frames of " +
                                             shape(like));
    }
}

} // namespace

void record_refine_input(Program& program, const Tensor& frames, const Tensor& counts,
                         const Tensor& residuals, uint32_t interval, const Tensor& input) {
    const Layout& layout = input.layout();
    check("frames", frames, interval + 2, frames);
    check("event counts", counts, 2 * interval + 2, frames);
    check("network inputs", input, residual_channels(interval), frames);
    const ChannelView pair = channel_view(frames, interval, 2);
    const ChannelView events = channel_view(counts, 2 * interval, 2);
    ChannelView before = pair; // stands in where there is no residual yet
    if (interval > 0) {
        check("residuals", residuals, interval, frames);
        before = channel_view(residuals, interval - 1, 1);
    }
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("refine_input", {}, 4, sizeof(InputPush));
    dispatch.arguments = {read(pair.tensor), read(events.tensor), read(before.tensor),
                          write(input)};
    dispatch.set_push(InputPush{PushLayout(pair.tensor), PushLayout(events.tensor),
                                PushLayout(before.tensor), PushLayout(input), layout.width,
                                layout.height, pair.skip, events.skip, before.skip,
                                interval == 0 ? 1U : 0U});
    dispatch.groups = pixel_groups(layout);
    const double pixels = static_cast<double>(layout.width) * layout.height;
    dispatch.flops = 4 * pixels;
    dispatch.bytes = pixels * 4 * (5 + padded_channels(layout));
    dispatch.label = "refine_input";
    program.add(std::move(dispatch));
}

void record_refine_update(Program& program, const Tensor& initial, const Tensor& frames,
                          const Tensor& residuals, const AlphaWeights& alpha,
                          const Tensor& updated) {
    const Layout& layout = frames.layout();
    const uint32_t d = layout.channels;
    const bool alone = d == 1;
    check("initial frames", initial, d, frames);
    check("updated frames", updated, d, frames);
    if (!alone) {
        check("residuals", residuals, d - 1, frames);
    }
    if (layout.block != 1 || initial.layout().block != 1 || updated.layout().block != 1 ||
        (!alone && residuals.layout().block != 1)) {
        throw Error(ExitCode::bad_input, "refinement: updates take frames of block 1");
    }
    const Kernel& kernel = program.device().kernel("refine_update", {}, 4, sizeof(UpdatePush));
    // Groups by the tensor with the largest planes; a group reads one frame more at each end.
    Layout largest = layout;
    for (const Tensor* tensor : {&initial, &updated, alone ? &frames : &residuals}) {
        if (tensor->layout().plane_stride() > largest.plane_stride()) {
            largest = tensor->layout();
        }
    }
    largest.channels = d;
    for (const auto& [first, count] : channel_groups(program.device().info(), largest, 1, 2)) {
        const uint32_t skip = first > 0 ? 1 : 0;
        const uint32_t begin = first - skip;
        const uint32_t end = std::min(first + count + 1, d);
        const Tensor starts = initial.channels(first, count);
        const Tensor around = frames.channels(begin, end - begin);
        const Tensor between =
            alone ? around : residuals.channels(begin, std::min(first + count, d - 1) - begin);
        const Tensor results = updated.channels(first, count);
        Dispatch dispatch;
        dispatch.kernel = &kernel;
        dispatch.arguments = {read(starts), read(around), read(between), write(results)};
        dispatch.set_push(UpdatePush{PushLayout(starts), PushLayout(around), PushLayout(between),
                                     PushLayout(results), layout.width, layout.height, first, d - 1,
                                     skip, alpha});
        dispatch.groups = pixel_groups(layout, count);
        const double values = static_cast<double>(layout.width) * layout.height * count;
        dispatch.flops = 32 * values;
        dispatch.bytes = 16 * values;
        dispatch.label = "refine_update";
        program.add(std::move(dispatch));
    }
}

} // namespace ecir
