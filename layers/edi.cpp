#include "layers/edi.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <numeric>
#include <string>

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"
#include "layers/smooth.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/edi.comp.
struct Push {
    PushLayout blurry;
    PushLayout frames;
    uint32_t width;
    uint32_t height;
    uint32_t sensor_width;
    uint32_t blurry_channel;
    uint32_t count; ///< frames in the schedule
    uint32_t first; ///< frame of the view's channel 0
    uint32_t limit; ///< frames in the view
};
static_assert(sizeof(Push) == 60);

/// Mirrors the push constants of shaders/edi_busy.comp.
struct BusyPush {
    PushLayout blurry;
    PushLayout frames;
    uint32_t width;
    uint32_t blurry_channel;
    uint32_t count;
    uint32_t first;
    uint32_t limit;
};
static_assert(sizeof(BusyPush) == 52);

/// Mirrors the push constants of shaders/edi_moments.comp.
struct MomentPush {
    uint32_t frames_origin;
    uint32_t moments_origin;
    uint32_t width;
    uint32_t height;
    uint32_t windows;
    uint32_t tile_columns;
    uint32_t tiles;
};
static_assert(sizeof(MomentPush) == 28);

constexpr uint32_t largest_side = 480;
constexpr uint32_t tile_pixels = 16;
constexpr uint32_t margin = 2; // of edi_moments.comp

/// Standard deviation 1.5 pixels, cut at 4 and normalised.
constexpr SmoothDesc kGaussian{
    .weights = {0.26655997F, 0.21344454F, 0.10958608F, 0.036074970F, 0.0076144192F}};

void check_input(const EdiInput& input, const Tensor& schedule, uint32_t frames) {
    const Layout& blurry = input.blurry.layout();
    const uint64_t pixels = uint64_t{blurry.width} * blurry.height;
    if (input.offsets.layout().elements() != pixels + 1 ||
        input.blurry_channel >= blurry.channels ||
        input.times.layout().width != input.marks.layout().width ||
        input.thresholds.layout().elements() != 2 ||
        schedule.layout().elements() != 2 * uint64_t{frames}) {
        throw Error(ExitCode::bad_input,
                    "EDI: " + std::to_string(input.offsets.layout().elements()) +
                        " event offsets, channel " + std::to_string(input.blurry_channel) +
                        " and a schedule of " + std::to_string(schedule.layout().elements() / 2) +
                        " frames do not match a " + std::to_string(blurry.width) + "x" +
                        std::to_string(blurry.height) + " image of " +
                        std::to_string(blurry.channels) + " channels and " +
                        std::to_string(frames) + " frames");
    }
}

/// The dispatch of shaders/edi.comp that writes frames first, ..., first + channels - 1 into
/// `view`.
Dispatch edi_dispatch(Program& program, const EdiInput& input, const Tensor& schedule,
                      const Tensor& view, uint32_t first, uint32_t bin, bool logarithm) {
    const std::array<uint32_t, 3> constants = {bin, logarithm ? 1U : 0U,
                                               edi_busy_events / (bin * bin)};
    const Layout& layout = view.layout();
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("edi", constants, 7, sizeof(Push));
    dispatch.arguments = {read(input.offsets), read(input.times), read(input.marks),
                          read(input.blurry),  read(schedule),    read(input.thresholds),
                          write(view)};
    dispatch.set_push(Push{PushLayout(input.blurry), PushLayout(view), layout.width, layout.height,
                           input.blurry.layout().width, input.blurry_channel,
                           static_cast<uint32_t>(schedule.layout().elements() / 2), first,
                           layout.channels});
    dispatch.groups = pixel_groups(layout);
    const auto events = static_cast<double>(input.marks.layout().elements());
    dispatch.flops = 12 * events + 12 * static_cast<double>(view.layout().elements());
    dispatch.bytes = 16 * events + static_cast<double>(view.bytes() + input.offsets.bytes());
    dispatch.label = logarithm ? "edi_logarithm" : "edi";
    return dispatch;
}

/// The dispatch of shaders/edi_busy.comp beside it.
Dispatch busy_dispatch(Program& program, const EdiInput& input, const Tensor& schedule,
                       const Tensor& busy, const Tensor& view, uint32_t first) {
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("edi_busy", {}, 8, sizeof(BusyPush));
    dispatch.arguments = {read(input.offsets), read(input.times), read(input.marks),
                          read(input.blurry),  read(schedule),    read(input.thresholds),
                          read(busy),          update(view)};
    dispatch.set_push(BusyPush{
        PushLayout(input.blurry), PushLayout(view), view.layout().width, input.blurry_channel,
        static_cast<uint32_t>(schedule.layout().elements() / 2), first, view.layout().channels});
    dispatch.groups = {busy.layout().width - 1, 1, 1};
    dispatch.bytes = static_cast<double>(busy.bytes());
    dispatch.label = "edi_busy";
    return dispatch;
}

} // namespace

std::vector<uint32_t> edi_schedule(std::span<const double> times) {
    std::vector<uint32_t> order(times.size());
    std::iota(order.begin(), order.end(), 0U);
    std::ranges::stable_sort(order, {}, [&](uint32_t i) { return times[i]; });
    std::vector<uint32_t> schedule;
    schedule.reserve(2 * times.size());
    for (const uint32_t frame : order) {
        if (!(times[frame] >= -1 && times[frame] <= 1)) {
            throw Error(ExitCode::bad_input, "frame time " + std::to_string(times[frame]) +
                                                 " lies outside the exposure, -1 to 1");
        }
        schedule.push_back(std::bit_cast<uint32_t>(static_cast<float>(times[frame])));
    }
    schedule.insert(schedule.end(), order.begin(), order.end());
    return schedule;
}

std::vector<uint32_t> edi_busy_pixels(const PackedEvents& events) {
    constexpr uint32_t most = 4'000'000;
    std::vector<uint32_t> busy(edi_busy_length(static_cast<uint32_t>(events.size())));
    for (uint32_t pixel = 0; pixel + 1 < events.offset.size(); ++pixel) {
        const uint32_t count = events.offset[pixel + 1] - events.offset[pixel];
        if (count > most) {
            throw Error(ExitCode::bad_input,
                        "pixel " + std::to_string(pixel) + " has " + std::to_string(count) +
                            " events in one exposure; EDI takes at most " + std::to_string(most));
        }
        if (count > edi_busy_events) {
            busy[++busy[0]] = pixel;
        }
    }
    return busy;
}

void record_edi(Program& program, const EdiInput& input, const Tensor& schedule, const Tensor& busy,
                const Tensor& frames) {
    const Layout& layout = frames.layout();
    check_input(input, schedule, layout.channels);
    if (busy.layout().width != edi_busy_length(input.marks.layout().width)) {
        throw Error(ExitCode::bad_input,
                    "EDI: the list of busy pixels has " + std::to_string(busy.layout().width) +
                        " places for " + std::to_string(input.marks.layout().width) + " events");
    }
    if (layout.block != 1 || layout.width != input.blurry.layout().width ||
        layout.height != input.blurry.layout().height) {
        throw Error(ExitCode::bad_input,
                    "EDI: the frames have another shape than the blurry image");
    }
    for (const auto& [first, count] : channel_groups(program.device().info(), layout, 1)) {
        const Tensor view = frames.channels(first, count);
        program.add(edi_dispatch(program, input, schedule, view, first, 1, false));
        if (busy.layout().width > 1) {
            program.add(busy_dispatch(program, input, schedule, busy, view, first));
        }
    }
}

EdiMomentShape edi_moment_shape(uint32_t width, uint32_t height) {
    if (width < 16 || height < 16) {
        throw Error(ExitCode::bad_input, "thresholds cannot be estimated from " +
                                             std::to_string(width) + "x" + std::to_string(height) +
                                             " pixels; at least 16x16 are needed");
    }
    EdiMomentShape shape{};
    // A long strip keeps its short side.
    shape.bin = std::max(1U, std::min((std::max(width, height) + largest_side - 1) / largest_side,
                                      std::min(width, height) / 16));
    shape.width = width / shape.bin;
    shape.height = height / shape.bin;
    shape.tile_columns = (shape.width - 2 * margin + tile_pixels - 1) / tile_pixels;
    shape.tile_rows = (shape.height - 2 * margin + tile_pixels - 1) / tile_pixels;
    return shape;
}

std::vector<double> edi_window_times() {
    std::vector<double> times(edi_windows + 1);
    for (uint32_t k = 0; k <= edi_windows; ++k) {
        times[k] = 2.0 * k / edi_windows - 1;
    }
    return times;
}

void record_edi_moments(Program& program, const EdiInput& input, const Tensor& schedule,
                        const Tensor& moments) {
    check_input(input, schedule, edi_windows + 1);
    const Layout& blurry = input.blurry.layout();
    const EdiMomentShape shape = edi_moment_shape(blurry.width, blurry.height);
    if (moments.layout().elements() != shape.layout().elements()) {
        throw Error(ExitCode::bad_input, "EDI moments: the output has another shape than theirs");
    }
    const Layout layout{edi_windows + 2, shape.height, shape.width};
    const Tensor frames = program.temporary(layout);
    program.add(edi_dispatch(program, input, schedule, frames, 0, shape.bin, true));
    const Tensor smooth = record_smooth(program, kGaussian, frames);

    Dispatch dispatch;
    const std::array<uint32_t, 1> constants = {std::bit_cast<uint32_t>(edi_motion_ridge)};
    dispatch.kernel = &program.device().kernel("edi_moments", constants, 3, sizeof(MomentPush));
    dispatch.arguments = {read(smooth), read(input.thresholds), write(moments)};
    dispatch.set_push(MomentPush{origin(smooth), origin(moments), shape.width, shape.height,
                                 edi_windows, shape.tile_columns, shape.tiles()});
    dispatch.groups = {(shape.tiles() + 63) / 64, edi_windows, 1};
    const double samples = 64.0 * shape.tiles() * edi_windows;
    dispatch.flops = 75 * samples;
    dispatch.bytes = static_cast<double>(smooth.bytes() + moments.bytes());
    dispatch.label = "edi_moments";
    program.add(std::move(dispatch));
}

} // namespace ecir
