#include "tools/simulate/motion.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "runtime/error.hpp"
#include "tools/simulate/random.hpp"

namespace ecir::sim {
namespace {

constexpr double pi = std::numbers::pi;
constexpr double largest_step_px = 0.5;
constexpr int fewest_sub_frames = 200;
constexpr int most_sub_frames = 1'000'000;
constexpr double across_share = 0.6; // a shake's width relative to its length
constexpr int samples_an_exposure = 256;

void check(const Motion& motion, int exposures) {
    const auto refuse = [](const char* message) { throw Error(ExitCode::usage, message); };
    if (!(motion.travel_px >= 0 && motion.travel_px <= 1e5)) {
        refuse("the travel must lie between 0 and 100000 pixels an exposure");
    }
    if (!std::isfinite(motion.angle_deg)) {
        refuse("the angle of the motion must be a number");
    }
    if (!(std::abs(motion.rotate_deg) <= 3600)) {
        refuse("the rotation must lie between -3600 and 3600 degrees an exposure");
    }
    if (!(motion.zoom >= 0.1 && motion.zoom <= 10)) {
        refuse("the zoom must lie between 0.1 and 10 an exposure");
    }
    if (exposures < 1) {
        refuse("a recording has at least one exposure");
    }
    if (motion.path == Path::linear &&
        (motion.travel_px * exposures > 1e6 || std::abs(std::log(motion.zoom)) * exposures > 5)) {
        refuse("the motion leads over 1000000 pixels or a magnification of 148 away from the start "
               "of the recording; give less travel, zoom or --count");
    }
}

template <class Waves> double sum(const Waves& waves, double time) {
    double value = 0;
    for (const auto& wave : waves) {
        value += wave.amplitude * std::sin(2 * pi * (wave.frequency * time + wave.phase));
    }
    return value;
}

template <class Waves> void scale(Waves& waves, double factor) {
    for (auto& wave : waves) {
        wave.amplitude *= factor;
    }
}

} // namespace

std::array<double, 2> unproject(const Pose& pose, double x, double y) {
    const double shrink = std::exp(-pose.log_zoom);
    const double c = std::cos(pose.radians) * shrink;
    const double s = std::sin(pose.radians) * shrink;
    const double u = x - pose.dx;
    const double v = y - pose.dy;
    return {c * u + s * v, c * v - s * u};
}

Trajectory::Trajectory(const Motion& motion, int exposures)
    : motion_(motion), exposures_(exposures) {
    check(motion, exposures);
    // A turn in the very middle would make the second half repeat the first.
    turn_phase_ = 0.5 - Random(motion.seed, 4).uniform(0.3, 0.7);
    if (motion.path == Path::shake) {
        make_shake();
    }
}

/// A hand shakes at about 3 to 13 Hz, that is 0.35 to 1.6 cycles in 120 ms, slower parts more
/// widely.
void Trajectory::make_shake() {
    constexpr std::array frequencies{0.35, 0.65, 1.05, 1.6};
    for (size_t axis = 0; axis < shake_.size(); ++axis) {
        Random random(motion_.seed, axis);
        for (const double centre : frequencies) {
            const double frequency = centre * random.uniform(0.85, 1.15);
            const double amplitude = random.uniform(0.5, 1) / frequency;
            shake_[axis].push_back({amplitude, frequency, random.uniform()});
        }
    }
    scale(shake_[1], across_share);

    // Lengths of the unscaled ways: of the translation, of the rotation, of the zoom.
    std::array<double, 3> length{};
    const auto sample = [this](int i) {
        std::array<double, 4> value{};
        for (size_t axis = 0; axis < value.size(); ++axis) {
            value[axis] = sum(shake_[axis], static_cast<double>(i) / samples_an_exposure);
        }
        return value;
    };
    auto before = sample(0);
    for (int i = 1; i <= exposures_ * samples_an_exposure; ++i) {
        const auto now = sample(i);
        length[0] += std::hypot(now[0] - before[0], now[1] - before[1]);
        length[1] += std::abs(now[2] - before[2]);
        length[2] += std::abs(now[3] - before[3]);
        before = now;
    }
    scale(shake_[0], motion_.travel_px * exposures_ / length[0]);
    scale(shake_[1], motion_.travel_px * exposures_ / length[0]);
    scale(shake_[2], motion_.rotate_deg * pi / 180 * exposures_ / length[1]);
    scale(shake_[3], std::log(motion_.zoom) * exposures_ / length[2]);
}

Pose Trajectory::at(double time) const {
    double along = 0, across = 0, radians = 0, log_zoom = 0;
    if (motion_.path == Path::shake) {
        along = sum(shake_[0], time);
        across = sum(shake_[1], time);
        radians = sum(shake_[2], time);
        log_zoom = sum(shake_[3], time);
    } else {
        // Half a sine wave an exposure is a way of twice its amplitude wherever it starts. A
        // straight way is centred, so that the least of the picture is needed.
        const double way = motion_.path == Path::reverse ? std::sin(pi * (time + turn_phase_)) / 2
                                                         : time - exposures_ / 2.0;
        along = motion_.travel_px * way;
        radians = motion_.rotate_deg * pi / 180 * way;
        log_zoom = std::log(motion_.zoom) * way;
    }
    const double c = std::cos(motion_.angle_deg * pi / 180);
    const double s = std::sin(motion_.angle_deg * pi / 180);
    return {c * along - s * across, s * along + c * across, radians, log_zoom};
}

int Trajectory::sub_frames(int width, int height, int multiple) const {
    // Between two poses a point's move is a linear map of the point, so a corner moves the most.
    // The step scales with the interval: measure it finely, then divide.
    const double x = width / 2.0;
    const double y = height / 2.0;
    double fastest = 0; // pixels a sample
    Pose before = at(0);
    for (int i = 1; i <= exposures_ * samples_an_exposure; ++i) {
        const Pose now = at(static_cast<double>(i) / samples_an_exposure);
        for (const auto& [u, v] : {std::array{x, y}, {-x, y}, {x, -y}, {-x, -y}}) {
            const auto a = unproject(before, u, v);
            const auto b = unproject(now, u, v);
            const double zoom = std::exp(std::max(before.log_zoom, now.log_zoom));
            fastest = std::max(fastest, zoom * std::hypot(a[0] - b[0], a[1] - b[1]));
        }
        before = now;
    }
    // The margin is for speeds between the samples.
    const double needed = 1.05 * fastest * samples_an_exposure / largest_step_px;
    if (needed > most_sub_frames) {
        throw Error(ExitCode::usage,
                    "the motion is too fast: it needs more than 1000000 sub-frames "
                    "an exposure; give less travel, rotation or zoom");
    }
    const int count = std::max(fewest_sub_frames, static_cast<int>(std::ceil(needed)));
    return (count + multiple - 1) / multiple * multiple;
}

} // namespace ecir::sim
