#include "layers/event_pack.hpp"

#include <algorithm>
#include <numeric>
#include <string>

#include "runtime/error.hpp"

namespace ecir {
namespace {

std::string number(int64_t value) {
    return std::to_string(value);
}

[[noreturn]] void reject(const std::string& message) {
    throw Error(ExitCode::bad_input, message);
}

void check_exposure(const Exposure& exposure) {
    // Unsigned, because the difference of two extreme times does not fit int64.
    const uint64_t duration =
        static_cast<uint64_t>(exposure.end) - static_cast<uint64_t>(exposure.start);
    if (exposure.end <= exposure.start) {
        reject("the exposure " + number(exposure.start) + " to " + number(exposure.end) +
               " us is empty: its end must come after its start");
    }
    if (duration > static_cast<uint64_t>(longest_exposure_us)) {
        reject("the exposure lasts " + std::to_string(duration) + " us; the longest supported is " +
               number(longest_exposure_us) + " us; are its times microseconds?");
    }
}

void check_event(const EventView& events, size_t i, const Exposure& exposure, uint32_t width,
                 uint32_t height) {
    const auto which = [&] {
        return "event " + std::to_string(i) + " at " + number(events.t[i]) + " us";
    };
    if (events.x[i] >= width || events.y[i] >= height) {
        reject(which() + ", x " + number(events.x[i]) + ", y " + number(events.y[i]) +
               " is outside the " + number(width) + "x" + number(height) + " image");
    }
    if (events.t[i] < exposure.start || events.t[i] > exposure.end) {
        reject(which() + " is outside the exposure " + number(exposure.start) + " to " +
               number(exposure.end) + " us");
    }
    if (i > 0 && events.t[i] < events.t[i - 1]) {
        reject(which() + " comes before its predecessor at " + number(events.t[i - 1]) +
               " us: events must be sorted by time");
    }
}

} // namespace

double normalised_time(int64_t t, const Exposure& exposure) {
    const int64_t duration = exposure.duration();
    return static_cast<double>(2 * (t - exposure.start) - duration) / static_cast<double>(duration);
}

void check_events(const EventView& events, const Exposure& exposure, uint32_t width,
                  uint32_t height) {
    check_exposure(exposure);
    const size_t count = events.size();
    if (count >= size_t{1} << 31) {
        reject(std::to_string(count) + " events in one exposure; fewer than 2^31 are supported");
    }
    for (size_t i = 0; i < count; ++i) {
        check_event(events, i, exposure, width, height);
    }
}

PackedEvents pack_events(const EventView& events, const Exposure& exposure, uint32_t width,
                         uint32_t height) {
    check_events(events, exposure, width, height);
    const size_t count = events.size();
    PackedEvents packed;
    packed.duration = exposure.duration();
    packed.offset.assign(size_t{width} * height + 1, 0);
    packed.time.resize(count);
    packed.mark.resize(count);
    packed.tick.resize(count);

    const auto pixel = [&](size_t i) { return size_t{events.y[i]} * width + events.x[i]; };
    for (size_t i = 0; i < count; ++i) {
        ++packed.offset[pixel(i) + 1];
    }
    std::partial_sum(packed.offset.begin(), packed.offset.end(), packed.offset.begin());

    std::vector<uint32_t> next(packed.offset.begin(), packed.offset.end() - 1);
    for (size_t i = 0; i < count; ++i) {
        const uint32_t place = next[pixel(i)]++;
        packed.time[place] = static_cast<float>(normalised_time(events.t[i], exposure));
        packed.mark[place] = (events.p[i] != 0 ? uint32_t{1} << 31 : 0U) | static_cast<uint32_t>(i);
        packed.tick[place] = static_cast<int32_t>(events.t[i] - exposure.start);
    }
    packed.positives.resize(count + 1);
    for (size_t place = 0; place < count; ++place) {
        packed.positives[place + 1] = packed.positives[place] + (packed.mark[place] >> 31);
    }
    return packed;
}

std::vector<float> release_times(const PackedEvents& events) {
    std::vector<float> times(events.size(), 0.0F);
    if (events.tick.empty()) {
        return times;
    }
    const auto [first, last] = std::ranges::minmax(events.tick);
    if (first == last) {
        return times;
    }
    const double span = last - first;
    std::ranges::transform(events.tick, times.begin(), [first = first, span](int32_t tick) {
        return static_cast<float>((tick - first) / span);
    });
    return times;
}

} // namespace ecir
