#pragma once
#include <array>
#include <cstdint>
#include <vector>

namespace ecir::sim {

enum class Path {
    linear,  ///< even speed all along
    reverse, ///< along one line, slowing down to turn back once in every exposure
    shake,   ///< a hand's: random, smooth, in all directions
};

/// How far the picture moves in the frame over one exposure. The figures are lengths of the way, so
/// a reversal of 20 px goes at most 10 px out. For shakes they are means over the recording's
/// exposures.
struct Motion {
    Path path = Path::linear;
    double travel_px = 0;  ///< >= 0, pixels of the output
    double angle_deg = 0;  ///< 0 to the right, 90 down; a shake's longer axis
    double rotate_deg = 0; ///< clockwise as seen, about the frame's centre
    double zoom = 1;       ///< > 0, magnification at the end relative to the start
    uint64_t seed = 1;     ///< of shakes, and of where in the exposure a reversal turns
};

/// The picture's pose in the frame. A picture point a, from the picture's centre in output pixels,
/// appears at exp(log_zoom) R(radians) a + (dx, dy) from the frame's centre.
struct Pose {
    double dx = 0;
    double dy = 0;
    double radians = 0;
    double log_zoom = 0;
};

/// A frame point (x, y) from the frame's centre -> the picture point that it shows.
std::array<double, 2> unproject(const Pose& pose, double x, double y);

/// The poses of a whole recording of `exposures` exposures that follow one another without a gap.
class Trajectory {
public:
    /// Throws Error(usage) when a figure is out of range.
    Trajectory(const Motion& motion, int exposures);

    /// `time` in exposures, 0 to the recording's end.
    [[nodiscard]] Pose at(double time) const;

    /// The smallest multiple of `multiple`, 200 or more, that cuts an exposure such that no pixel
    /// of a width x height frame moves over 0.5 px between two sub-frames. Throws Error(usage) over
    /// 1e6.
    [[nodiscard]] int sub_frames(int width, int height, int multiple) const;

    [[nodiscard]] int exposures() const { return exposures_; }

private:
    struct Wave {
        double amplitude, frequency, phase; ///< frequency in cycles an exposure
    };
    using Waves = std::vector<Wave>;
    void make_shake();

    Motion motion_;
    int exposures_;
    double turn_phase_ = 0;
    std::array<Waves, 4> shake_; ///< along, across, rotation, log zoom
};

} // namespace ecir::sim
