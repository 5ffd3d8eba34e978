#include <algorithm>
#include <cmath>

#include "tools/simulate/random.hpp"
#include "tools/stability/frames.hpp"

// Numbers, times and signs of events that no scene gives, and the ends of what clocks can tell.

namespace ecir::stability {
namespace {

constexpr int64_t kTenSeconds = 10'000'000;

Capture nominal_capture(const Subject& subject, double) {
    return capture(subject, nominal(subject));
}

/// A picture that stands still, and so many events at random all the same.
Capture still_with_events(const Subject& subject, double count) {
    Setting setting = nominal(subject);
    setting.motion.travel_px = 0;
    Capture made = capture(subject, setting);
    sim::Random random(subject.seed, 77);
    std::vector<int64_t> times(static_cast<size_t>(count));
    for (int64_t& time : times) {
        time = static_cast<int64_t>(random.uniform(0, static_cast<double>(setting.exposure_us)));
    }
    std::ranges::sort(times);
    for (const int64_t time : times) {
        const uint64_t bits = random.bits();
        made.events.push_back(time, static_cast<uint16_t>((bits >> 32) % made.width),
                              static_cast<uint16_t>((bits >> 48) % made.height),
                              static_cast<uint8_t>(bits & 1));
    }
    return made;
}

/// The nominal scene and besides so many events, of either sign by turns, at the middle pixel.
Capture one_pixel(const Subject& subject, double count) {
    Capture made = nominal_capture(subject, 0);
    const auto number = static_cast<int64_t>(count);
    const int64_t duration = made.exposure.duration();
    for (int64_t i = 0; i < number; ++i) {
        made.events.push_back(made.exposure.start + i * duration / std::max<int64_t>(number, 1),
                              static_cast<uint16_t>(made.width / 2),
                              static_cast<uint16_t>(made.height / 2), static_cast<uint8_t>(i & 1));
    }
    made.events = sorted(made.events);
    return made;
}

/// A share of the events, those of random pixels, all at one microsecond in mid-exposure.
Capture at_once(const Subject& subject, double share) {
    Capture made = nominal_capture(subject, 0);
    sim::Random random(subject.seed, 78);
    const int64_t middle = (made.exposure.start + made.exposure.end) / 2;
    for (int64_t& time : made.events.t) {
        time = random.uniform() <= share ? middle : time;
    }
    made.events = sorted(made.events);
    return made;
}

Capture one_sign(const Subject& subject, double lost) {
    Capture made = nominal_capture(subject, 0);
    sim::Random random(subject.seed, 79);
    made.events = filtered(
        made.events, [&](size_t i) { return made.events.p[i] == 1 || random.uniform() > lost; });
    return made;
}

/// Every event moved to the nearest of the borders of so many equal intervals.
Capture at_borders(const Subject& subject, double intervals) {
    Capture made = nominal_capture(subject, 0);
    const double width = static_cast<double>(made.exposure.duration()) / intervals;
    made.events = retimed(made.events, [&](int64_t time) {
        const auto start = static_cast<double>(made.exposure.start);
        const double border = std::round((static_cast<double>(time) - start) / width) * width;
        return made.exposure.start + std::llround(border);
    });
    return made;
}

Capture started_at(const Subject& subject, double start) {
    Setting setting = nominal(subject);
    setting.start_us = static_cast<int64_t>(start);
    return capture(subject, setting);
}

/// The nominal scene's way in so many microseconds.
Capture lasting(const Subject& subject, double duration) {
    Setting setting = nominal(subject);
    setting.exposure_us = static_cast<int64_t>(duration);
    return capture(subject, setting);
}

/// The same scene at ten seconds, its events' times rounded to what the short exposure can tell.
Capture lasting_long(const Subject& subject, double duration) {
    Capture made = lasting(subject, static_cast<double>(kTenSeconds));
    const double grain = static_cast<double>(kTenSeconds) / duration;
    made.events = retimed(made.events, [&](int64_t time) {
        return std::llround(std::round(static_cast<double>(time) / grain) * grain);
    });
    return made;
}

Sweep shortest() {
    Sweep sweep{.name = "events-exposure",
                .title = "Exposures of 100 us to 10 s, the same way in each",
                .x = {"length of the exposure, us", cli::svg::Spread::logarithmic}};
    sweep.values = {100, 200, 1e3, 1e4, 1e5, 1e6, 1e7};
    sweep.quick = {100, 1e7};
    sweep.safe = "time is normalised by whole microseconds; the frames are those of a 10 s "
                 "exposure with as coarse a clock";
    sweep.promises = {{"", 100, 1e7}};
    return against_same(std::move(sweep), lasting, lasting_long);
}

} // namespace

std::vector<Sweep> event_sweeps() {
    std::vector<Sweep> sweeps;

    Sweep number{.name = "events-number",
                 .title = "A still picture with so many events at random",
                 .x = {"events in the exposure", cli::svg::Spread::listed}};
    number.values = {0, 1, 10, 100, 1e3, 1e4, 1e5, 1e6, 1e7};
    number.quick = {0, 1, 1000};
    number.safe =
        "any number gives finite frames; to a network events that come alone are noise, and "
        "where nothing moves the frame stays the blurry one";
    number.promises = {{"", 0, 0}, {"edi", 0, 100}};
    sweeps.push_back(against_same(number, still_with_events, [](const Subject& subject, double) {
        return still_with_events(subject, 0);
    }));

    Sweep pixel{.name = "events-one-pixel",
                .title = "Up to a million events at one pixel: what they do elsewhere",
                .x = {"events added at the middle pixel", cli::svg::Spread::listed}};
    pixel.values = {0, 1, 10, 100, 1e3, 1e4, 1e5, 1e6};
    pixel.quick = {0, 1e4};
    pixel.safe = "the networks take a pixel of over 768 events as one without and say how many; "
                 "to EDI each pixel is its own";
    pixel.promises = {{"edi", 0, 1e6}, {"ecir", 0, 1e6}, {"fusion", 0, 1e6}};
    sweeps.push_back(against_same(pixel, one_pixel, nominal_capture,
                                  [](const Subject& subject, uint32_t x, uint32_t y) {
                                      return x != subject.width / 2 || y != subject.height / 2;
                                  }));

    Sweep once{.name = "events-at-once",
               .title = "Events all at one microsecond",
               .x = {"share of the events moved to mid-exposure"}};
    once.values = {0, 0.1, 0.25, 0.5, 0.75, 0.9, 1};
    once.quick = {0, 1};
    once.safe = "finite frames; the mean stays the blurry frame's";
    once.promises = {{"", 0, 0.9}};
    sweeps.push_back(against_blurry(once, at_once));

    Sweep sign{.name = "events-one-sign",
               .title = "Negative events lost, up to one sign only",
               .x = {"share of the negative events lost"}};
    sign.values = {0, 0.1, 0.25, 0.5, 0.75, 1};
    sign.quick = {0, 1};
    sign.safe = "finite frames; the estimate gives the signs thresholds of their own, as far as "
                "the missing ones allow";
    sign.promises = {{"", 0, 0.5}};
    sweeps.push_back(against_blurry(sign, one_sign));

    Sweep borders{.name = "events-borders",
                  .title = "Events in bursts on the borders of bins and cells",
                  .x = {"equal intervals whose borders the events move to (9: cells of the "
                        "keypoints, 20: bins)",
                        cli::svg::Spread::listed}};
    borders.values = {200, 40, 20, 18, 9, 4, 2};
    borders.quick = {20, 9};
    borders.safe = "borders are compared in whole microseconds, each event belongs to one interval";
    borders.promises = {{"", 2, 200}};
    sweeps.push_back(against_blurry(borders, at_borders));

    Sweep clock{.name = "events-clock",
                .title = "The clock at the exposure's start",
                .x = {"us", cli::svg::Spread::listed}};
    clock.values = {0, 1, 1e6, 1e9, 1e12, 1.6e15, 4e18};
    clock.quick = {0, 1.6e15};
    clock.labels = {"0", "1", "1e6", "1e9", "1e12", "1.6e15", "4e18"};
    clock.safe = "times stay whole until the start is subtracted: the same bits at any clock";
    clock.promises = {{"", 0, 4e18}};
    clock.limit = 0;
    sweeps.push_back(against_same(clock, started_at, nominal_capture));

    sweeps.push_back(shortest());
    return sweeps;
}

} // namespace ecir::stability
