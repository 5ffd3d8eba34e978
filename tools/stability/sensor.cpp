#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/simulate/random.hpp"
#include "tools/stability/frames.hpp"

// Faults of event sensors.

namespace ecir::stability {
namespace {

/// Pixels drawn with a chance of `share`.
std::vector<bool> chosen(const Subject& subject, double share, uint64_t stream) {
    sim::Random random(subject.seed, stream);
    std::vector<bool> pixels(size_t{subject.width} * subject.height);
    for (auto&& pixel : pixels) {
        pixel = random.uniform() <= share && share > 0;
    }
    return pixels;
}

Capture threshold_told(const Subject& subject, double factor) {
    Setting setting = nominal(subject);
    Capture made = capture(subject, setting);
    made.told = {static_cast<float>(setting.camera.positive * factor),
                 static_cast<float>(setting.camera.negative * factor)};
    return made;
}

Capture threshold(const Subject& subject, double value) {
    Setting setting = nominal(subject);
    setting.camera.positive = setting.camera.negative = value;
    setting.camera.sigma = 0.15 * value;
    return capture(subject, setting);
}

Capture signs_apart(const Subject& subject, double ratio) {
    Setting setting = nominal(subject);
    setting.camera.positive *= std::sqrt(ratio);
    setting.camera.negative /= std::sqrt(ratio);
    return capture(subject, setting);
}

Capture pattern(const Subject& subject, double spread) {
    Setting setting = nominal(subject);
    setting.camera.pixel_spread = spread;
    return capture(subject, setting);
}

Capture refractory(const Subject& subject, double period) {
    Setting setting = nominal(subject);
    setting.camera.refractory_us = static_cast<int64_t>(period);
    return capture(subject, setting);
}

Capture dead(const Subject& subject, double share) {
    Capture made = capture(subject, nominal(subject));
    const auto gone = chosen(subject, share, 81);
    made.events = filtered(made.events, [&](size_t i) {
        return !gone[size_t{made.events.y[i]} * subject.width + made.events.x[i]];
    });
    return made;
}

Capture hot(const Subject& subject, double share) {
    Setting setting = nominal(subject);
    setting.camera.hot_fraction = share;
    return capture(subject, setting);
}

/// Noise events at so many times the rate of the scene's own.
Capture noise(const Subject& subject, double ratio) {
    Capture made = capture(subject, nominal(subject));
    sim::Random random(subject.seed, 82);
    const auto count = static_cast<size_t>(ratio * static_cast<double>(made.events.size()));
    for (size_t i = 0; i < count; ++i) {
        const uint64_t bits = random.bits();
        made.events.push_back(
            made.exposure.start + static_cast<int64_t>(random.uniform(
                                      0, static_cast<double>(made.exposure.duration()))),
            static_cast<uint16_t>((bits >> 32) % made.width),
            static_cast<uint16_t>((bits >> 48) % made.height), static_cast<uint8_t>(bits & 1));
    }
    made.events = sorted(made.events);
    return made;
}

/// A bus that passes nothing for so large a share of every tenth of the exposure.
Capture dropped(const Subject& subject, double share) {
    Capture made = capture(subject, nominal(subject));
    const auto period = static_cast<double>(made.exposure.duration()) / 10;
    sim::Random random(subject.seed, 83);
    const double phase = random.uniform();
    made.events = filtered(made.events, [&](size_t i) {
        const double place =
            static_cast<double>(made.events.t[i] - made.exposure.start) / period + phase;
        return place - std::floor(place) >= share;
    });
    return made;
}

Capture late(const Subject& subject, double milliseconds) {
    Setting setting = nominal(subject);
    setting.before = true;
    Capture made = capture(subject, setting);
    made.events = retimed(made.events,
                          [&](int64_t time) { return time + std::llround(1000 * milliseconds); });
    return made;
}

} // namespace

std::vector<Sweep> sensor_sweeps() {
    std::vector<Sweep> sweeps;

    Sweep told{.name = "sensor-threshold-told",
               .title = "The threshold given with --threshold, wrong by a factor",
               .x = {"given over true threshold (0.2)", cli::svg::Spread::logarithmic}};
    told.values = {0.5, 0.7, 0.85, 1, 1.2, 1.4, 1.7, 2};
    told.quick = {0.5, 2};
    told.safe =
        "finite frames whose mean stays the blurry frame; leaving --threshold out estimates "
        "it; ecir takes none";
    told.promises = {{"", 0.5, 2}};
    sweeps.push_back(against_blurry(told, threshold_told));

    Sweep true_threshold{.name = "sensor-threshold",
                         .title = "The sensor's threshold, not told",
                         .x = {"true threshold of both signs", cli::svg::Spread::logarithmic}};
    true_threshold.values = {0.05, 0.1, 0.14, 0.2, 0.28, 0.4, 0.6, 1};
    true_threshold.quick = {0.1, 0.4};
    true_threshold.safe = "EDI and fusion estimate it from the frame and its events";
    true_threshold.promises = {{"", 0.05, 1}};
    sweeps.push_back(against_blurry(true_threshold, threshold));

    Sweep signs{.name = "sensor-signs",
                .title = "The two signs' thresholds apart",
                .x = {"C+ over C-", cli::svg::Spread::logarithmic}};
    signs.values = {0.5, 0.7, 0.85, 1, 1.2, 1.4, 2};
    signs.quick = {0.5, 2};
    signs.safe = "the estimate gives each sign its own threshold";
    signs.promises = {{"", 0.5, 2}};
    sweeps.push_back(against_blurry(signs, signs_apart));

    Sweep spread{.name = "sensor-pattern",
                 .title = "Fixed pattern: thresholds that vary from pixel to pixel",
                 .x = {"standard deviation over the mean threshold"}};
    spread.values = {0, 0.05, 0.1, 0.2, 0.3, 0.5};
    spread.quick = {0.3};
    spread.safe = "the frame's own mean holds each pixel; fusion's network evens out the rest";
    spread.promises = {{"", 0, 0.5}};
    sweeps.push_back(against_blurry(spread, pattern));

    Sweep dead_time{.name = "sensor-refractory",
                    .title = "A pixel's dead time after an event",
                    .x = {"refractory period, us", cli::svg::Spread::listed}};
    dead_time.values = {0, 100, 300, 1000, 3000, 10000, 30000};
    dead_time.quick = {0, 1000};
    dead_time.safe = "events lost at strong edges look like higher thresholds to the estimate";
    dead_time.promises = {{"", 0, 30000}};
    sweeps.push_back(against_blurry(dead_time, refractory));

    Sweep dead_pixels{.name = "sensor-dead",
                      .title = "Dead pixels",
                      .x = {"share of the pixels that give no event"}};
    dead_pixels.values = {0, 0.01, 0.05, 0.1, 0.25, 0.5, 0.9};
    dead_pixels.quick = {0.1};
    dead_pixels.safe =
        "such a pixel keeps the blurry value, which the networks fill from beside it";
    dead_pixels.promises = {{"", 0, 0.9}};
    sweeps.push_back(against_blurry(dead_pixels, dead));

    Sweep hot_pixels{.name = "sensor-hot",
                     .title = "Hot pixels that fire at 500 Hz",
                     .x = {"share of the pixels", cli::svg::Spread::listed}};
    hot_pixels.values = {0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3};
    hot_pixels.quick = {0.01};
    hot_pixels.safe = "finite frames; the harm stays at the pixels and their neighbours";
    hot_pixels.promises = {{"fusion", 0, 0.3}, {"edi", 0, 0.1}, {"ecir", 0, 0.3}};
    sweeps.push_back(against_blurry(hot_pixels, hot));

    Sweep noisy{.name = "sensor-noise",
                .title = "Background noise events",
                .x = {"noise events over the scene's own", cli::svg::Spread::listed}};
    noisy.values = {0, 0.1, 0.25, 0.5, 0.75, 1, 2};
    noisy.quick = {0, 0.5};
    noisy.safe = "finite frames; the estimate lowers the thresholds, fusion's network sees noise";
    noisy.promises = {{"fusion", 0, 2}, {"edi", 0, 1}, {"ecir", 0, 2}};
    sweeps.push_back(against_blurry(noisy, noise));

    Sweep bus{.name = "sensor-bus",
              .title = "A saturated bus: bursts of lost events",
              .x = {"share of the time in which all events are lost"}};
    bus.values = {0, 0.1, 0.25, 0.5, 0.75, 0.9};
    bus.quick = {0.25};
    bus.safe = "finite frames; lost events look like higher thresholds to the estimate";
    bus.promises = {{"", 0, 0.75}};
    sweeps.push_back(against_blurry(bus, dropped));

    Sweep delay{.name = "sensor-late",
                .title = "Events late against the frame (exposure 120 ms, 12 px of travel)",
                .x = {"delay of the events, ms"}};
    delay.values = {-10, -5, -2, -1, 0, 1, 2, 5, 10, 20, 40};
    delay.quick = {0, 5};
    delay.safe =
        "finite frames; the scene is then sharp but displaced by the motion in the delay, which "
        "--lag auto finds";
    delay.promises = {{"", -10, 40}};
    delay.warnings = {"late"};
    sweeps.push_back(against_blurry(delay, late));
    return sweeps;
}

} // namespace ecir::stability
