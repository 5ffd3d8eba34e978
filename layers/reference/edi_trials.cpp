#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "layers/edi.hpp"
#include "layers/edi_moments.hpp"
#include "layers/reference/edi.hpp"

namespace ecir {
namespace {

struct Case {
    uint32_t width, height;
    uint32_t frames;
    uint32_t events; ///< most of one pixel
    EdiThresholds thresholds;
    uint32_t halo;
    bool blocked; ///< blurry as channel 3 of a tensor in blocks of 8
};

/// The last one: 100,000 events and more, as `bench` gives to whole models.
constexpr std::array<Case, 11> cases = {{
    {1, 1, 1, 5, {0.2F, 0.2F}, 0, false},
    {17, 5, 3, 0, {0.2F, 0.2F}, 0, false},
    {64, 3, 14, 12, {0.3F, 0.25F}, 1, false},
    {65, 2, 14, 12, {0.12F, 0.15F}, 0, true},
    {33, 9, 5, 40, {0.2F, 0.35F}, 0, false},
    {130, 1, 2, 40, {0.35F, 0.2F}, 1, true},
    {31, 4, 100, 7, {0.2F, 0.2F}, 0, false},
    {2, 2, 14, 3000, {0.2F, 0.2F}, 0, false},
    {3, 4, 50, 9000, {0.2F, 0.21F}, 1, true}, // more events than edi_busy_events
    {346, 260, 14, 30, {0.2F, 0.22F}, 0, false},
    {240, 180, 14, 5, {0.2F, 0.2F}, 0, false},
}};

constexpr std::array<std::array<uint32_t, 2>, 5> moment_sizes = {{
    {16, 16},
    {33, 21},
    {64, 48},
    {490, 40}, // binned by 2
    {240, 180},
}};

/// Makes the inputs of a program that depend on the events and the thresholds; write_input() fills
/// them.
EdiInput make_input(Program& program, const PackedEvents& events, const Layout& blurry,
                    uint32_t channel) {
    const auto count = std::max(1U, static_cast<uint32_t>(events.size()));
    EdiInput input;
    input.offsets = program.input({1, 1, static_cast<uint32_t>(events.offset.size())});
    input.times = program.input({1, 1, count});
    input.marks = program.input({1, 1, count});
    input.blurry = program.input(blurry);
    input.thresholds = program.input({1, 1, 2});
    input.blurry_channel = channel;
    return input;
}

void write_input(Program& program, const EdiInput& input, const PackedEvents& events,
                 const std::vector<float>& blurry, const EdiThresholds& thresholds) {
    program.write(input.offsets, events.offset);
    program.write(input.times, events.time);
    program.write(input.marks, events.mark);
    program.write(input.blurry, blurry);
    program.write(input.thresholds, std::vector<float>{thresholds.positive, thresholds.negative});
}

std::string size_text(uint32_t width, uint32_t height) {
    return std::to_string(width) + "x" + std::to_string(height);
}

} // namespace

PackedEvents random_packed_events(CaseRandom& random, size_t pixels, uint32_t most) {
    PackedEvents events;
    events.offset.push_back(0);
    events.positives.push_back(0);
    for (size_t p = 0; p < pixels; ++p) {
        const uint32_t count = random.integer(0, most);
        std::vector<float> times = random.values(count, -1, 1);
        for (uint32_t i = 0; i < count; ++i) {
            switch (random.integer(0, 15)) {
            case 0:
                times[i] = -1;
                break;
            case 1:
                times[i] = 1;
                break;
            case 2:
                times[i] = times[i / 2];
                break;
            case 3:
                times[i] = static_cast<float>(random.integer(0, 32)) / 16 - 1;
                break;
            default:
                break;
            }
        }
        std::ranges::sort(times);
        for (const float time : times) {
            events.time.push_back(time);
            const uint32_t positive = random.integer(0, 1);
            events.mark.push_back(positive << 31 | static_cast<uint32_t>(events.mark.size()));
            events.positives.push_back(events.positives.back() + positive);
        }
        events.offset.push_back(static_cast<uint32_t>(events.mark.size()));
    }
    return events;
}

Trial edi_trial(Device& device, uint32_t trial) {
    const Case& shape = cases.at(trial);
    const size_t pixels = size_t{shape.width} * shape.height;
    CaseRandom random(400 + trial);
    const PackedEvents events = random_packed_events(random, pixels, shape.events);
    const std::vector<float> image = random.values(pixels, 0, 1);
    std::vector<double> times(shape.frames);
    for (double& time : times) {
        time = double{static_cast<float>(random.uniform(-1, 1))};
    }
    times.front() = 1;
    times.back() = -1;
    if (!events.time.empty()) { // a frame at an event's very time
        times[times.size() / 2] = double{events.time[events.time.size() / 2]};
    }

    Trial result;
    result.shape = size_text(shape.width, shape.height) + " " + std::to_string(shape.frames) +
                   " frames, up to " + std::to_string(shape.events) + " events a pixel";
    result.reference = reference::edi(image, events, times, shape.thresholds);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const uint32_t channel = shape.blocked ? 3 : 0;
    const Layout layout{channel + 1, shape.height, shape.width, shape.blocked ? 8U : 1U,
                        shape.halo};
    const EdiInput input = make_input(program, events, layout, channel);
    const Tensor schedule = program.input({1, 2, shape.frames});
    const Tensor busy = program.input({1, 1, edi_busy_length(input.marks.layout().width)});
    result.output = program.output({shape.frames, shape.height, shape.width, 1, shape.halo});
    program.clear(result.output);
    result.first_step = program.steps();
    record_edi(program, input, schedule, busy, result.output);
    program.finish();
    // The channels that the kernel must not read hold large values.
    std::vector<float> channels((channel + 1) * pixels, 1e6F);
    std::ranges::copy(image, channels.end() - static_cast<ptrdiff_t>(pixels));
    write_input(program, input, events, from_dense(layout, channels), shape.thresholds);
    program.write(schedule, edi_schedule(times));
    program.write(busy, edi_busy_pixels(events));
    return result;
}

Trial edi_moments_trial(Device& device, uint32_t trial) {
    const auto [width, height] = moment_sizes.at(trial);
    const size_t pixels = size_t{width} * height;
    CaseRandom random(500 + trial);
    const PackedEvents events = random_packed_events(random, pixels, 12);
    const std::vector<float> image = random.values(pixels, 0, 1);
    constexpr EdiThresholds thresholds{0.25F, 0.2F};

    Trial result;
    result.shape = size_text(width, height);
    result.reference = reference::edi_moments(image, events, width, height, thresholds);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const EdiInput input = make_input(program, events, {1, height, width}, 0);
    const EdiMomentShape sizes = edi_moment_shape(width, height);
    const Tensor fields = program.temporary(sizes.fields());
    result.output = program.output(sizes.moments());
    record_edi_fields(program, input, fields);
    record_edi_moments(program, input, fields, result.output);
    program.finish();
    write_input(program, input, events, image, thresholds);
    return result;
}

} // namespace ecir
