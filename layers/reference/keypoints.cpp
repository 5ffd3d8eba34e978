#include "layers/reference/keypoints.hpp"

#include <array>
#include <cstdlib>
#include <string>

#include "layers/keypoints.hpp"
#include "layers/reference/histogram.hpp"

namespace ecir {
namespace {

struct Case {
    uint32_t width, height;
    uint32_t events;
    uint32_t n;
    bool release;
    uint32_t block; ///< 0 for the device's
    uint32_t halo, first;
    int64_t duration;
    bool even = false; ///< events
};

/// Durations that 2 (n - 1) divides have pivots and borders on whole microseconds, with exact ties.
/// The last one: as in the network, with events all over.
constexpr std::array<Case, 13> cases = {{
    {1, 1, 0, 2, false, 1, 0, 0, 120000},
    {1, 1, 0, 10, true, 1, 0, 0, 120000},
    {1, 1, 1, 10, true, 1, 0, 0, 120000},
    {1, 1, 500, 10, false, 8, 1, 1, 180000},
    {17, 5, 400, 10, false, 8, 1, 1, 120000},
    {17, 5, 400, 10, true, 8, 1, 1, 120000},
    {64, 3, 2000, 3, false, 1, 0, 0, 400},
    {65, 3, 2000, 20, false, 4, 2, 2, 38 * 1000},
    {31, 13, 6000, 20, true, 16, 1, 1, longest_exposure_us},
    {33, 9, 6000, 20, false, 8, 1, 1, longest_exposure_us},
    {47, 2, 3000, 7, false, 1, 1, 3, 1},
    {130, 2, 3000, 2, true, 1, 0, 0, 7},
    {240, 180, 100000, 10, false, 0, 2, 0, 120000, true},
}};

} // namespace

std::vector<double> reference::keypoints(const EventView& events, const Exposure& exposure,
                                         uint32_t n, bool release, uint32_t width,
                                         uint32_t height) {
    const size_t pixels = size_t{width} * height;
    const int64_t m = int64_t{n} - 1;
    std::vector<double> result(n * pixels);
    for (size_t i = 0; i < result.size(); ++i) {
        const auto pivot = static_cast<int64_t>(i / pixels);
        result[i] = static_cast<float>(static_cast<double>(2 * pivot - m) / static_cast<double>(m));
    }
    if (events.size() == 0) {
        return result;
    }
    // Time is numerator / span.
    const int64_t span = release ? events.t.back() - events.t.front() : exposure.duration();
    const int64_t zero = release ? events.t.front() : exposure.start;
    if (span == 0) {
        return result;
    }
    std::vector<int64_t> nearest(n * pixels, INT64_MAX);
    for (size_t e = 0; e < events.size(); ++e) {
        const int64_t numerator = release ? events.t[e] - zero : 2 * (events.t[e] - zero) - span;
        // All times m span from here on: the event lies at m numerator, pivot k at (2 k - m) span
        // and the border below it at (2 k - m - 1) span.
        int64_t cell = m;
        while (m * numerator < (2 * cell - m - 1) * span) {
            --cell;
        }
        const int64_t distance = std::abs(m * numerator - (2 * cell - m) * span);
        const size_t index =
            static_cast<size_t>(cell) * pixels + size_t{events.y[e]} * width + events.x[e];
        if (distance < nearest[index]) {
            nearest[index] = distance;
            result[index] =
                static_cast<float>(static_cast<double>(numerator) / static_cast<double>(span));
        }
    }
    return result;
}

Trial keypoints_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.block = case_block(device, shape.block);
    CaseRandom random(200 + trial);
    const Exposure exposure{-5000, -5000 + shape.duration};
    const Events events =
        shape.even ? even_events(random, exposure, shape.width, shape.height, shape.events)
                   : random_events(random, exposure, shape.width, shape.height, shape.events,
                                   2 * (shape.n - 1));
    const PackedEvents packed = pack_events(events.view(), exposure, shape.width, shape.height);

    Trial result;
    result.shape = std::to_string(shape.events) + " events, n " + std::to_string(shape.n) +
                   (shape.release ? " release, " : " paper, ") + std::to_string(shape.width) + "x" +
                   std::to_string(shape.height) + " block " + std::to_string(shape.block) + ", " +
                   std::to_string(shape.duration) + " us";
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const auto line = [](size_t width) {
        Layout layout;
        layout.width = static_cast<uint32_t>(width);
        return layout;
    };
    const Tensor offsets = program.input(line(packed.offset.size()));
    const Tensor times = program.input(line(packed.size() + 1));
    const Tensor ticks = program.input(line(packed.size() + 1));
    const Tensor rule = program.input(line(4));
    const uint32_t channels = shape.first + shape.n;
    result.output =
        program.output({channels, shape.height, shape.width, shape.block, shape.halo, 0});
    program.clear(result.output);
    result.first_step = program.steps();
    record_keypoints(program, offsets, times, ticks, rule, result.output, shape.first, shape.n);
    program.finish();
    program.write(offsets, packed.offset);
    program.write(times, shape.release ? release_times(packed) : packed.time);
    program.write(ticks, packed.tick);
    const KeypointRule values = shape.release ? release_keypoint_rule(packed, shape.n)
                                              : paper_keypoint_rule(packed, shape.n);
    program.write(rule, std::as_bytes(std::span(&values, 1)));

    // The channels in front of the keypoints keep what they held: here zeros.
    result.reference.assign(size_t{shape.first} * shape.width * shape.height, 0.0);
    const auto keypoints = reference::keypoints(events.view(), exposure, shape.n, shape.release,
                                                shape.width, shape.height);
    result.reference.insert(result.reference.end(), keypoints.begin(), keypoints.end());
    return result;
}

} // namespace ecir
