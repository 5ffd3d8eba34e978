#include "layers/edi.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <numeric>
#include <string>

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/edi.comp and edi_busy.comp.
struct Push {
    PushLayout blurry;
    PushLayout frames;
    uint32_t width;
    uint32_t blurry_channel;
    uint32_t count; ///< frames in the schedule
    uint32_t first; ///< frame of the view's channel 0
    uint32_t limit; ///< frames in the view
};
static_assert(sizeof(Push) == 52);

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
                      const Tensor& view, uint32_t first) {
    const std::array<uint32_t, 1> constants = {edi_busy_events};
    const Layout& layout = view.layout();
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("edi", constants, 7, sizeof(Push));
    dispatch.arguments = {read(input.offsets), read(input.times), read(input.marks),
                          read(input.blurry),  read(schedule),    read(input.thresholds),
                          write(view)};
    dispatch.set_push(
        Push{PushLayout(input.blurry), PushLayout(view), layout.width, input.blurry_channel,
             static_cast<uint32_t>(schedule.layout().elements() / 2), first, layout.channels});
    dispatch.groups = pixel_groups(layout);
    const auto events = static_cast<double>(input.marks.layout().elements());
    dispatch.flops = 12 * events + 12 * static_cast<double>(view.layout().elements());
    dispatch.bytes = 16 * events + static_cast<double>(view.bytes() + input.offsets.bytes());
    dispatch.label = "edi";
    return dispatch;
}

/// The dispatch of shaders/edi_busy.comp beside it.
Dispatch busy_dispatch(Program& program, const EdiInput& input, const Tensor& schedule,
                       const Tensor& busy, const Tensor& view, uint32_t first) {
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("edi_busy", {}, 8, sizeof(Push));
    dispatch.arguments = {read(input.offsets), read(input.times), read(input.marks),
                          read(input.blurry),  read(schedule),    read(input.thresholds),
                          read(busy),          update(view)};
    dispatch.set_push(Push{
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
            throw Error(ExitCode::bad_input, "a pixel has " + std::to_string(count) +
                                                 " events in one exposure; EDI takes at most " +
                                                 std::to_string(most) +
                                                 "; mask hot pixels in the sensor");
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
        program.add(edi_dispatch(program, input, schedule, view, first));
        if (busy.layout().width > 1) {
            program.add(busy_dispatch(program, input, schedule, busy, view, first));
        }
    }
}

} // namespace ecir
