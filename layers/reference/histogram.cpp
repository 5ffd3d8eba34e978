#include "layers/reference/histogram.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <string>

#include "layers/histogram.hpp"

namespace ecir {
namespace {

struct Case {
    uint32_t width, height;
    uint32_t events;
    uint32_t intervals;
    bool release;
    uint32_t block; ///< 0 for the device's
    uint32_t halo;
    bool even = false; ///< in space and time, the events and the intervals
};

/// The last two: the network's input, and what its refinement sees of 14 frames.
constexpr std::array<Case, 12> cases = {{
    {1, 1, 0, 1, false, 1, 0},
    {1, 1, 300, 13, true, 1, 0},
    {1, 7, 90, 20, false, 8, 1},
    {17, 5, 400, 20, false, 1, 0},
    {17, 5, 400, 13, true, 8, 1},
    {64, 3, 1000, 13, true, 4, 2},
    {65, 9, 2000, 7, false, 16, 1},
    {33, 21, 5000, 20, false, 8, 1},
    {47, 13, 5000, 13, true, 1, 1},
    {130, 2, 3, 3, true, 1, 0},
    {240, 180, 100000, 20, false, 0, 2, true},
    {240, 180, 100000, 13, false, 1, 0, true},
}};

std::vector<double> case_edges(CaseRandom& random, const Case& shape, uint32_t trial) {
    if (trial % 3 == 0 || shape.even) {
        return shape.release ? linspace_edges(0.9027777777777778, shape.intervals)
                             : even_edges(shape.intervals);
    }
    if (trial % 3 == 1) {
        return shape.release ? linspace_edges(1, shape.intervals) : even_edges(shape.intervals);
    }
    // Requested times: any distances, some equal.
    std::vector<double> edges(shape.intervals + 1);
    for (double& edge : edges) {
        edge = static_cast<float>(random.uniform(-1, 1));
    }
    edges.back() = edges.front();
    std::ranges::sort(edges);
    return edges;
}

} // namespace

std::vector<double> reference::histogram(const EventView& events, const Exposure& exposure,
                                         std::span<const double> edges, bool release,
                                         uint32_t width, uint32_t height) {
    const size_t intervals = edges.size() < 2 ? 0 : edges.size() - 1;
    const size_t pixels = size_t{width} * height;
    std::vector<double> counts(2 * intervals * pixels, 0.0);
    for (size_t i = 0; i < intervals; ++i) {
        const bool closed = release || i + 1 == intervals;
        std::vector<size_t> members;
        for (size_t e = 0; e < events.size(); ++e) {
            const double t = normalised_time(events.t[e], exposure);
            if (t >= edges[i] && (t < edges[i + 1] || (closed && t == edges[i + 1]))) {
                members.push_back(e);
            }
        }
        if (release && !members.empty()) {
            int64_t latest = events.t[members.front()];
            for (const size_t e : members) {
                latest = std::max(latest, events.t[e]);
            }
            std::erase_if(members, [&](size_t e) { return events.t[e] == latest; });
        }
        for (const size_t e : members) {
            const size_t channel = 2 * i + (events.p[e] != 0 ? 0 : 1);
            counts[channel * pixels + size_t{events.y[e]} * width + events.x[e]] += 1;
        }
    }
    return counts;
}

Events random_events(CaseRandom& random, const Exposure& exposure, uint32_t width, uint32_t height,
                     uint32_t count, uint32_t grid) {
    struct One {
        int64_t t;
        uint16_t x, y;
        uint8_t p;
    };
    std::vector<One> all(count);
    const int64_t duration = exposure.duration();
    for (uint32_t i = 0; i < count; ++i) {
        One& one = all[i];
        int64_t tick = static_cast<int64_t>(random.uniform(0, static_cast<double>(duration) + 1));
        switch (random.integer(0, 7)) {
        case 0: // on the grid of edges, pivots and borders
            tick = duration * random.integer(0, grid) / grid;
            break;
        case 1: // a tie with the event made before
            tick = i > 0 ? all[i - 1].t - exposure.start : 0;
            break;
        case 2:
            tick = random.integer(0, 1) * duration;
            break;
        default:
            break;
        }
        one.t = exposure.start + tick;
        // A quarter at one pixel; a third of the sensor's pixels stay without events.
        const bool busy = random.integer(0, 3) == 0;
        const uint32_t pixels = width * height;
        const uint32_t pixel =
            busy ? pixels / 2 : std::min(random.integer(0, pixels - 1) / 3 * 3, pixels - 1);
        one.x = static_cast<uint16_t>(pixel % width);
        one.y = static_cast<uint16_t>(pixel / width);
        one.p = static_cast<uint8_t>(random.integer(0, 1));
    }
    std::ranges::stable_sort(all, {}, &One::t);
    Events events;
    for (const One& one : all) {
        events.push_back(one.t, one.x, one.y, one.p);
    }
    return events;
}

Events even_events(CaseRandom& random, const Exposure& exposure, uint32_t width, uint32_t height,
                   uint32_t count) {
    Events events;
    for (uint32_t i = 0; i < count; ++i) {
        const uint32_t pixel = random.integer(0, width * height - 1);
        events.push_back(exposure.start + exposure.duration() * i / count,
                         static_cast<uint16_t>(pixel % width), static_cast<uint16_t>(pixel / width),
                         static_cast<uint8_t>(random.integer(0, 1)));
    }
    return events;
}

Trial event_histogram_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.block = case_block(device, shape.block);
    CaseRandom random(100 + trial);
    const Exposure exposure{1'600'000'000'000'000, 1'600'000'000'120'000};
    const Events events =
        shape.even ? even_events(random, exposure, shape.width, shape.height, shape.events)
                   : random_events(random, exposure, shape.width, shape.height, shape.events,
                                   shape.intervals);
    const std::vector<double> edges = case_edges(random, shape, trial);
    const PackedEvents packed = pack_events(events.view(), exposure, shape.width, shape.height);
    const auto ranges = shape.release ? release_intervals(events.view(), exposure, edges)
                                      : paper_intervals(events.view(), exposure, edges);

    Trial result;
    result.shape = std::to_string(shape.events) + " events, " + std::to_string(shape.intervals) +
                   (shape.release ? " release" : " paper") + " intervals, " +
                   std::to_string(shape.width) + "x" + std::to_string(shape.height) + " block " +
                   std::to_string(shape.block);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const auto line = [](size_t width) {
        Layout layout;
        layout.width = static_cast<uint32_t>(width);
        return layout;
    };
    const Tensor offsets = program.input(line(packed.offset.size()));
    const Tensor marks = program.input(line(packed.size() + 1));
    const Tensor positives = program.input(line(packed.size() + 1));
    const Tensor intervals = program.input(line(2 * ranges.size()));
    result.output = program.output(
        {2 * shape.intervals, shape.height, shape.width, shape.block, shape.halo, 0});
    program.clear(result.output);
    result.first_step = program.steps();
    record_event_histogram(program, offsets, marks, positives, intervals, result.output);
    program.finish();
    program.write(offsets, packed.offset);
    program.write(marks, packed.mark);
    program.write(positives, packed.positives);
    program.write(intervals, std::as_bytes(std::span(ranges)));
    result.reference = reference::histogram(events.view(), exposure, edges, shape.release,
                                            shape.width, shape.height);
    return result;
}

} // namespace ecir
