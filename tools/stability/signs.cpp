#include "tools/stability/signs.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <span>

namespace ecir::stability {
namespace {

double share_of(std::span<const float> values, auto holds) {
    return static_cast<double>(std::ranges::count_if(values, holds)) /
           static_cast<double>(values.size());
}

/// Of events sorted by time.
double most_frequent_time(std::span<const int64_t> times) {
    size_t most = 0;
    for (size_t i = 0; i < times.size();) {
        size_t end = i;
        while (end < times.size() && times[end] == times[i]) {
            ++end;
        }
        most = std::max(most, end - i);
        i = end;
    }
    return static_cast<double>(most);
}

double in_step(const EventView& events, double hertz) {
    std::complex<double> sum = 0;
    for (size_t i = 0; i < events.size(); ++i) {
        const double phase =
            2e-6 * std::numbers::pi * hertz * static_cast<double>(events.t[i] - events.t.front());
        sum += std::polar(events.p[i] == 1 ? 1.0 : -1.0, -phase);
    }
    return std::abs(sum);
}

/// Events with none of the eight pixels around in the `reach` microseconds before.
double unsupported(const EventView& events, uint32_t width, uint32_t height, int64_t reach) {
    constexpr int64_t never = std::numeric_limits<int64_t>::min() / 2;
    const size_t row = size_t{width} + 2; // a border of pixels without events
    std::vector<int64_t> last(row * (size_t{height} + 2), never);
    double count = 0;
    for (size_t i = 0; i < events.size(); ++i) {
        const size_t centre = (size_t{events.y[i]} + 1) * row + events.x[i] + 1;
        int64_t latest = never;
        for (const size_t line : {centre - row, centre, centre + row}) {
            latest = std::max(
                {latest, last[line - 1], last[line + 1], line == centre ? never : last[line]});
        }
        count += latest < events.t[i] - reach ? 1 : 0;
        last[centre] = events.t[i];
    }
    return count;
}

} // namespace

Signs signs_of(const Capture& capture) {
    const EventView events = window(capture.events.view(), capture.exposure);
    const auto total = static_cast<double>(events.size());
    const double any = std::max(total, 1.0);
    const std::vector<uint32_t> counts = event_counts(events, capture.width, capture.height);
    constexpr size_t parts = 100;
    std::array<double, parts> rate{};
    double positive = 0;
    for (size_t i = 0; i < events.size(); ++i) {
        positive += events.p[i];
        const auto part =
            static_cast<size_t>((events.t[i] - capture.exposure.start) *
                                static_cast<int64_t>(parts) / (capture.exposure.duration() + 1));
        ++rate.at(part);
    }
    const auto pixels = static_cast<double>(capture.pixels());
    const auto active =
        static_cast<double>(std::ranges::count_if(counts, [](uint32_t n) { return n > 0; }));
    return {
        {"saturated", share_of(capture.blurry, [](float v) { return v >= 0.97F; })},
        {"dark", share_of(capture.blurry, [](float v) { return v <= 0.03F; })},
        {"events a pixel", total / pixels},
        {"active", active / pixels},
        {"busiest pixel", *std::ranges::max_element(counts)},
        {"balance", (2 * positive - total) / any},
        {"same time", most_frequent_time(events.t) / any},
        {"fullest", *std::ranges::max_element(rate) / any},
        {"empty", static_cast<double>(std::ranges::count(rate, 0.0)) / parts},
        {"100 Hz", in_step(events, 100) / any},
        {"120 Hz", in_step(events, 120) / any},
        {"unsupported",
         unsupported(events, capture.width, capture.height, capture.exposure.duration() / 20) /
             any},
    };
}

} // namespace ecir::stability
