#include <algorithm>
#include <cmath>
#include <numbers>

#include "tools/stability/frames.hpp"

// Too little light, too much, and light that changes.

namespace ecir::stability {
namespace {

Capture lit(const Subject& subject, std::function<double(double)> light, int bits = 8) {
    Setting setting = nominal(subject);
    setting.light = std::move(light);
    setting.bits = bits;
    return capture(subject, setting);
}

Capture constant_light(const Subject& subject, double brightness) {
    return lit(subject, [brightness](double) { return brightness; });
}

Capture lamp(const Subject& subject, double brightness) {
    Setting setting = nominal(subject);
    const double width = subject.width;
    setting.disc = Disc{.radius_px = 0.06 * width,
                        .centre =
                            [width](double time) {
                                return std::array<double, 2>{(time - 0.5) * 0.2 * width, 0.0};
                            },
                        .brightness = static_cast<float>(brightness)};
    return capture(subject, setting);
}

Capture bits(const Subject& subject, double depth) {
    return lit(subject, {}, static_cast<int>(depth));
}

/// A 16-bit frame of a scene that uses so small a part of its range.
Capture range(const Subject& subject, double part) {
    return lit(
        subject, [part](double) { return part; }, 16);
}

/// A lamp on the mains: brightness 1 + m cos, over its peak.
auto flicker(double hertz) {
    return [hertz](const Subject& subject, double modulation) {
        return lit(subject, [hertz, modulation](double time) {
            const double phase = 2 * std::numbers::pi * hertz * 0.12 * time + 1;
            return (1 + modulation * std::cos(phase)) / (1 + modulation);
        });
    };
}

Capture drift(const Subject& subject, double factor) {
    return lit(subject,
               [factor](double time) { return std::pow(factor, time) / std::max(1.0, factor); });
}

} // namespace

std::vector<Sweep> light_sweeps() {
    std::vector<Sweep> sweeps;

    Sweep dark{.name = "light-dark",
               .title = "From daylight to black, an 8-bit frame",
               .x = {"brightness of the scene", cli::svg::Spread::listed}};
    dark.values = {1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01, 0};
    dark.quick = {0.1, 0};
    dark.safe = "the offset of 0.01 keeps logarithms finite; ecir's networks see a dark frame "
                "brightened; a black one without events stays black";
    dark.promises = {{"", 0, 1}};
    sweeps.push_back(against_blurry(dark, constant_light));

    Sweep depth{.name = "light-range",
                .title = "A 16-bit frame of which the scene uses a part",
                .x = {"brightness of the scene", cli::svg::Spread::listed}};
    depth.values = {1, 0.5, 0.2, 0.1, 0.05, 0.02, 0.01};
    depth.quick = {0.1};
    depth.safe = "16 bits are read as they are; nothing is rounded to 8";
    depth.promises = {{"", 0.01, 1}};
    sweeps.push_back(against_blurry(depth, range));

    Sweep coarse{.name = "light-bits",
                 .title = "Bits of the blurry frame",
                 .x = {"bits", cli::svg::Spread::listed}};
    coarse.values = {16, 12, 10, 8, 6, 5, 4, 3};
    coarse.quick = {16, 6};
    coarse.safe = "the frames inherit the blurry frame's steps and no more";
    coarse.promises = {{"", 3, 16}};
    sweeps.push_back(against_blurry(coarse, bits));

    Sweep bright{.name = "light-saturated",
                 .title = "A scene too bright for the frame camera, which clips",
                 .x = {"brightness of the scene", cli::svg::Spread::listed}};
    bright.values = {1, 1.2, 1.5, 2, 3, 5, 10};
    bright.quick = {1.5};
    bright.safe = "finite frames; where the frame is clipped its mean is not the scene's: "
                  "warned of as saturated";
    bright.promises = {{"", 1, 3}};
    sweeps.push_back(against_blurry(bright, constant_light));

    Sweep moving{.name = "light-lamp",
                 .title = "A lamp that moves through the frame",
                 .x = {"its brightness, 1: the frame's white", cli::svg::Spread::listed}};
    moving.values = {0.5, 1, 1.5, 2, 4, 8, 16};
    moving.quick = {2};
    moving.safe = "finite frames; trails of clipped lamps are warned of as saturated";
    moving.promises = {{"", 0.5, 16}};
    sweeps.push_back(against_blurry(moving, lamp));

    for (const double hertz : {100.0, 120.0}) {
        const std::string name = hertz == 100 ? "100" : "120";
        Sweep lamps{.name = "light-flicker-" + name,
                    .title = "Lamps that flicker at " + name + " Hz",
                    .x = {"modulation of their light"}};
        lamps.values = {0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8};
        lamps.quick = {0.1};
        lamps.safe = "finite frames; flicker gives events without motion: warned of as flicker";
        lamps.promises = {{"", 0, 0.2}};
        sweeps.push_back(against_blurry(lamps, flicker(hertz)));
    }

    Sweep change{
        .name = "light-drift",
        .title = "A change of the light during the exposure",
        .x = {"brightness at its end over that at its start", cli::svg::Spread::logarithmic}};
    change.values = {0.25, 0.5, 0.7, 0.85, 1, 1.2, 1.4, 2, 4};
    change.quick = {0.7, 1.4};
    change.safe = "finite frames; the estimate of the thresholds takes the signs' balance for "
                  "theirs; warned of as one-sign where over 85 % of the events have one";
    change.promises = {{"", 0.25, 4}};
    sweeps.push_back(against_blurry(change, drift));
    return sweeps;
}

} // namespace ecir::stability
