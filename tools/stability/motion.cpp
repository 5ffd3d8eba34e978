#include <cmath>

#include "tools/stability/frames.hpp"

// What moves, how far and how.

namespace ecir::stability {
namespace {

Capture travel(const Subject& subject, double pixels) {
    Setting setting = nominal(subject);
    setting.motion.travel_px = pixels;
    return capture(subject, setting);
}

Capture reversals(const Subject& subject, double turns) {
    Setting setting = nominal(subject);
    if (turns > 0) {
        setting.motion.path = sim::Path::reverse;
        setting.turns = static_cast<int>(turns);
    }
    return capture(subject, setting);
}

Capture rotation(const Subject& subject, double degrees) {
    Setting setting = nominal(subject);
    setting.motion.travel_px = 0;
    setting.motion.rotate_deg = degrees;
    return capture(subject, setting);
}

/// A disc of that share of the frame's width goes over a picture that moves slowly.
Capture occlusion(const Subject& subject, double share) {
    Setting setting = nominal(subject);
    setting.motion.travel_px = 4;
    const double width = subject.width;
    setting.disc = Disc{.radius_px = share * width / 2, .centre = [width](double time) {
                            return std::array<double, 2>{(time - 0.5) * 0.3 * width, 0.0};
                        }};
    return capture(subject, setting);
}

/// A disc a fifth of the frame wide that crosses the whole frame in that share of the exposure.
Capture crossing(const Subject& subject, double share) {
    Setting setting = nominal(subject);
    setting.motion.travel_px = 4;
    const double width = subject.width;
    setting.disc = Disc{.radius_px = 0.1 * width, .centre = [width, share](double time) {
                            return std::array<double, 2>{(time - 0.5) / share * 1.25 * width, 0.0};
                        }};
    return capture(subject, setting);
}

} // namespace

std::vector<Sweep> motion_sweeps() {
    std::vector<Sweep> sweeps;

    Sweep way{.name = "motion-travel",
              .title = "Travel in the exposure, in a straight line",
              .x = {"pixels, of a frame 128 wide", cli::svg::Spread::listed}};
    way.values = {0, 1, 2, 5, 10, 20, 40, 80, 120, 200};
    way.quick = {0, 12};
    way.safe = "without motion or events the frames are the blurry one";
    way.promises = {{"", 0, 200}};
    sweeps.push_back(against_blurry(way, travel));

    Sweep turning{.name = "motion-reversals",
                  .title = "Turning back within the exposure, 12 px between two turns",
                  .x = {"reversals in the exposure", cli::svg::Spread::listed}};
    turning.values = {0, 1, 2, 4, 8, 16};
    turning.quick = {2};
    turning.safe = "fusion has motion of its own between nine moments, EDI none; ecir's polynomial "
                   "follows as many turns as it has keypoints for";
    turning.promises = {{"", 0, 8}};
    sweeps.push_back(against_blurry(turning, reversals));

    Sweep turn{.name = "motion-rotation",
               .title = "Rotation about the frame's centre",
               .x = {"degrees in the exposure", cli::svg::Spread::listed}};
    turn.values = {0, 1, 2, 5, 10, 20, 45, 90};
    turn.quick = {10};
    turn.safe = "motion is estimated pixel by pixel, so a rotation is like any other";
    turn.promises = {{"", 0, 90}};
    sweeps.push_back(against_blurry(turn, rotation));

    Sweep covered{.name = "motion-occlusion",
                  .title = "Something in front moves by 0.3 of the frame's width",
                  .x = {"its size over the frame's width"}};
    covered.values = {0, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8};
    covered.quick = {0.2};
    covered.safe = "where motion finds no match the network falls back to the pixel's own events";
    covered.promises = {{"", 0, 0.8}};
    sweeps.push_back(against_blurry(covered, occlusion));

    Sweep passing{.name = "motion-crossing",
                  .title = "Something enters, crosses the frame and leaves within the exposure",
                  .x = {"share of the exposure in which it is in view", cli::svg::Spread::listed}};
    passing.values = {1, 0.7, 0.5, 0.3, 0.2, 0.1, 0.05};
    passing.quick = {0.5};
    passing.safe = "as for occlusion; the faster it passes, the more events in a shorter time";
    passing.promises = {{"", 0.05, 1}};
    sweeps.push_back(against_blurry(passing, crossing));
    return sweeps;
}

} // namespace ecir::stability
