#include "layers/histogram.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>
#include <ranges>
#include <string>

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/event_histogram.comp.
struct Push {
    PushLayout counts;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t first = 0;    ///< interval of the view's channel 0
    uint32_t count = 0;    ///< intervals in the view
    uint32_t channels = 0; ///< of the view, with the last block filled up
};
static_assert(sizeof(Push) == 36);

void check_edges(std::span<const double> edges) {
    // Not is_sorted: a NaN must fail too.
    for (size_t i = 1; i < edges.size(); ++i) {
        if (!(edges[i - 1] <= edges[i])) {
            throw Error(ExitCode::bad_input, "histogram edge " + std::to_string(i) + " (" +
                                                 std::to_string(edges[i]) +
                                                 ") lies before the edge in front of it");
        }
    }
}

/// How many of the events come before `edge`, or (closed) not after it.
uint32_t events_up_to(const EventView& events, const Exposure& exposure, double edge, bool closed) {
    const auto end = std::ranges::partition_point(events.t, [&](int64_t t) {
        const double time = normalised_time(t, exposure);
        return closed ? time <= edge : time < edge;
    });
    return static_cast<uint32_t>(end - events.t.begin());
}

} // namespace

std::vector<double> even_edges(uint32_t intervals) {
    std::vector<double> edges(intervals + 1);
    for (uint32_t i = 0; i <= intervals; ++i) {
        edges[i] = (2.0 * i - intervals) / intervals;
    }
    return edges;
}

std::vector<double> linspace_edges(double span, uint32_t intervals) {
    std::vector<double> edges(intervals + 1);
    const double step = (span - -span) / intervals;
    for (uint32_t i = 0; i < intervals; ++i) {
        edges[i] = i * step + -span;
    }
    edges[intervals] = span;
    return edges;
}

std::vector<IntervalRange> paper_intervals(const EventView& events, const Exposure& exposure,
                                           std::span<const double> edges) {
    check_edges(edges);
    std::vector<IntervalRange> ranges;
    for (size_t i = 0; i + 1 < edges.size(); ++i) {
        const bool last = i + 2 == edges.size();
        ranges.push_back({events_up_to(events, exposure, edges[i], false),
                          events_up_to(events, exposure, edges[i + 1], last)});
    }
    return ranges;
}

std::vector<IntervalRange> release_intervals(const EventView& events, const Exposure& exposure,
                                             std::span<const double> edges) {
    check_edges(edges);
    std::vector<IntervalRange> ranges;
    for (size_t i = 0; i + 1 < edges.size(); ++i) {
        IntervalRange range{events_up_to(events, exposure, edges[i], false),
                            events_up_to(events, exposure, edges[i + 1], true)};
        if (range.end > range.begin) {
            const auto latest = std::ranges::lower_bound(events.t, events.t[range.end - 1]);
            range.end = std::max(range.begin, static_cast<uint32_t>(latest - events.t.begin()));
        }
        ranges.push_back(range);
    }
    return ranges;
}

std::vector<IntervalRange> outward_intervals(const EventView& events, const Exposure& exposure,
                                             double time, uint32_t bins) {
    if (exposure.end <= exposure.start || bins == 0 || !(time >= -1 && time <= 1)) {
        throw Error(ExitCode::bad_input, std::to_string(bins) + " intervals outwards from " +
                                             std::to_string(time) + " in an exposure from " +
                                             std::to_string(exposure.start) + " to " +
                                             std::to_string(exposure.end) +
                                             " us: it needs an interval or more, a time from -1 "
                                             "to 1 and an end after the start");
    }
    constexpr int64_t kFraction = 1024; // of a microsecond; exact products for any exposure
    const int64_t duration = exposure.duration() * kFraction;
    const int64_t instant = std::llrint((time + 1) / 2 * static_cast<double>(duration));
    const auto range_of = [&](int64_t t) {
        const int64_t distance = (t - exposure.start) * kFraction - instant;
        const int64_t bin = std::min<int64_t>(bins * std::abs(distance) / duration, bins - 1);
        return distance < 0 ? bins - 1 - bin : bins + bin;
    };
    std::vector<IntervalRange> ranges;
    uint32_t begin = 0;
    for (uint32_t i = 0; i < 2 * bins; ++i) {
        const auto after =
            std::ranges::partition_point(events.t, [&](int64_t t) { return range_of(t) <= i; });
        const auto end = static_cast<uint32_t>(after - events.t.begin());
        ranges.push_back({begin, end});
        begin = end;
    }
    return ranges;
}

void record_event_histogram(Program& program, const Tensor& offsets, const Tensor& marks,
                            const Tensor& positives, const Tensor& intervals,
                            const Tensor& counts) {
    const Layout& layout = counts.layout();
    const uint32_t pixels = layout.width * layout.height;
    if (intervals.layout().width != layout.channels || layout.channels % 2 != 0 ||
        offsets.layout().width != pixels + 1) {
        throw Error(ExitCode::bad_input,
                    "event histogram: " + std::to_string(layout.channels) + " channels of " +
                        std::to_string(pixels) + " pixels do not match " +
                        std::to_string(intervals.layout().width) + " interval bounds and " +
                        std::to_string(offsets.layout().width) + " pixel offsets");
    }
    const Kernel& kernel = program.device().kernel("event_histogram", {}, 5, sizeof(Push));
    const uint32_t step = std::lcm(2U, layout.block);
    for (const auto& [first, count] : channel_groups(program.device().info(), layout, step)) {
        const Tensor view = counts.channels(first, count);
        Dispatch dispatch;
        dispatch.kernel = &kernel;
        dispatch.arguments = {read(offsets), read(marks), read(positives), read(intervals),
                              write(view)};
        dispatch.set_push(Push{PushLayout(view), layout.width, layout.height, first / 2, count / 2,
                               padded_channels(view.layout())});
        dispatch.groups = pixel_groups(layout);
        dispatch.bytes = static_cast<double>(view.bytes() + offsets.bytes() + marks.bytes());
        dispatch.label = "event_histogram";
        program.add(std::move(dispatch));
    }
}

} // namespace ecir
