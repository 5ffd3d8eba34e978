#pragma once
#include <array>
#include <cstddef>
#include <filesystem>
#include <vector>

#include "tools/io/image.hpp"
#include "tools/simulate/motion.hpp"

namespace ecir::sim {

/// Averages `image` over boxes: output pixel (i, j) is the mean over columns [left + i pitch_x,
/// left + (i + 1) pitch_x) and rows alike, with parts of pixels weighted by their share. Boxes must
/// lie inside the image (rounding aside).
io::Image area_average(const io::Image& image, double left, double top, double pitch_x,
                       double pitch_y, int width, int height);

/// A sharp scene over time; between its knots each pixel is linear in time. Times are microseconds
/// from the recording's start.
class Scene {
public:
    Scene() = default;
    Scene(const Scene&) = delete;
    Scene& operator=(const Scene&) = delete;
    virtual ~Scene() = default;

    /// The sharp frame of this moment. Cheapest when asked for in the order of time.
    virtual io::Image at(double time_us) = 0;
    /// The knots in [start, end], both ends among them, ascending.
    [[nodiscard]] virtual std::vector<double> knots(double start_us, double end_us) const = 0;
};

/// A still picture that moves. It is shrunk as far as the motion leaves no border in view; a
/// picture too small for that stays at its own resolution and is mirrored at its borders. A pixel
/// is the mean of four bilinear samples of the picture, so that detail does not flicker as it moves
/// through the pixel grid.
class StillScene : public Scene {
public:
    /// `multiple`: the sub-frames an exposure become a multiple of it (d - 1 puts the truth on
    /// knots). Throws Error(bad_input) when the picture is smaller than width x height,
    /// Error(usage) when the motion is out of range.
    StillScene(const io::Image& picture, const Motion& motion, int width, int height,
               double exposure_us, int exposures, int multiple);

    io::Image at(double time_us) override;
    [[nodiscard]] std::vector<double> knots(double start_us, double end_us) const override;
    [[nodiscard]] int sub_frames() const { return sub_frames_; }

private:
    Trajectory trajectory_;
    int width_;
    int height_;
    double exposure_us_;
    int sub_frames_;
    io::Image canvas_; ///< the picture at one or two of its pixels a frame pixel
    double density_x_; ///< canvas pixels a frame pixel
    double density_y_;
};

/// Sharp frames from files, evenly spaced in time from 0 on, linearly interpolated between.
class FrameScene : public Scene {
public:
    /// The frames are cropped about the middle to the shape of width x height, then area-averaged.
    /// Throws Error(usage) for fps outside (0, 1e6]. Reading throws Error(bad_input), also for
    /// frames of different sizes or smaller than width x height.
    FrameScene(std::vector<std::filesystem::path> files, double fps, int width, int height);

    io::Image at(double time_us) override;
    [[nodiscard]] std::vector<double> knots(double start_us, double end_us) const override;
    /// Time of the last frame.
    [[nodiscard]] double end_us() const;

private:
    const io::Image& frame(size_t index);

    std::vector<std::filesystem::path> files_;
    double interval_us_;
    int width_;
    int height_;
    int source_width_ = 0; ///< of the first frame read
    int source_height_ = 0;
    struct Cached {
        size_t index = 0;
        io::Image image;
    };
    std::array<Cached, 2> cache_; ///< by the index's parity
};

} // namespace ecir::sim
