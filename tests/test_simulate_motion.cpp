#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "runtime/error.hpp"
#include "tests/simulate_support.hpp"
#include "tools/simulate/esim.hpp"
#include "tools/simulate/motion.hpp"
#include "tools/simulate/recording.hpp"
#include "tools/simulate/scene.hpp"

using namespace ecir;
using namespace ecir::sim;
using namespace ecir::test;

namespace {

/// Length of the way of the frame's centre over exposure `index`.
double way(const Trajectory& trajectory, int index) {
    double length = 0;
    for (int i = 0; i < 1000; ++i) {
        const Pose a = trajectory.at(index + i / 1000.0);
        const Pose b = trajectory.at(index + (i + 1) / 1000.0);
        length += std::hypot(b.dx - a.dx, b.dy - a.dy);
    }
    return length;
}

} // namespace

TEST_SUITE("simulate motion") {
    TEST_CASE("motions go as far as they say") {
        const Trajectory linear(moving(Path::linear, 20, 90, 8, 1.2), 3);
        const Pose start = linear.at(1);
        const Pose end = linear.at(2);
        CHECK(end.dx - start.dx == doctest::Approx(0));
        CHECK(end.dy - start.dy == doctest::Approx(20));
        CHECK(end.radians - start.radians == doctest::Approx(8 * std::numbers::pi / 180));
        CHECK(std::exp(end.log_zoom - start.log_zoom) == doctest::Approx(1.2));

        const Trajectory reverse(moving(Path::reverse, 20), 2);
        CHECK(way(reverse, 0) == doctest::Approx(20).epsilon(1e-4));
        CHECK(way(reverse, 1) == doctest::Approx(20).epsilon(1e-4));
        CHECK(std::abs(reverse.at(1).dx - reverse.at(0).dx) < 10);

        const Trajectory shake(moving(Path::shake, 20), 4);
        const double mean = (way(shake, 0) + way(shake, 1) + way(shake, 2) + way(shake, 3)) / 4;
        CHECK(mean == doctest::Approx(20).epsilon(1e-3));
    }

    TEST_CASE("no pixel moves over half a pixel between sub-frames") {
        for (const Path path : {Path::linear, Path::reverse, Path::shake}) {
            const Trajectory trajectory(moving(path, 300, 20, 15, 1.3), 2);
            const int count = trajectory.sub_frames(60, 40, 13);
            CHECK(count % 13 == 0);
            CHECK(count >= 200);
            for (int i = 0; i < 2 * count; ++i) {
                const Pose a = trajectory.at(static_cast<double>(i) / count);
                const Pose b = trajectory.at(static_cast<double>(i + 1) / count);
                for (const double x : {-30.0, 30.0}) {
                    const auto p = unproject(a, x, 20);
                    // Where the picture point goes: through the second pose.
                    const double c = std::cos(b.radians) * std::exp(b.log_zoom);
                    const double s = std::sin(b.radians) * std::exp(b.log_zoom);
                    const double u = c * p[0] - s * p[1] + b.dx;
                    const double v = s * p[0] + c * p[1] + b.dy;
                    REQUIRE(std::hypot(u - x, v - 20) <= 0.5);
                }
            }
        }
        CHECK(Trajectory(Motion{}, 1).sub_frames(60, 40, 1) == 200);
    }

    TEST_CASE("a still moves to the right by its travel") {
        // A ramp across: a move by s lowers each pixel by s steps.
        const double slope = 0.01;
        const auto ramp = picture(60, 40, [&](int x, int) { return 0.2 + slope * x; });
        StillScene scene(ramp, moving(Path::linear, 8), 40, 30, 1000, 1, 1);
        const io::Image start = scene.at(0);
        const io::Image middle = scene.at(500);
        const io::Image end = scene.at(1000);
        // The motion needs 48 pixels of 60 and 30 of 40, so the picture is shrunk by 1.25.
        const size_t centre = 15 * 40 + 20;
        CHECK(start.pixels[centre] - end.pixels[centre] == doctest::Approx(8 * 1.25 * slope));
        CHECK(start.pixels[centre] - middle.pixels[centre] == doctest::Approx(4 * 1.25 * slope));
    }

    TEST_CASE("a picture without room to spare is mirrored at its borders") {
        const auto ramp = picture(32, 32, [](int x, int) { return x / 31.0; });
        StillScene scene(ramp, moving(Path::linear, 20), 32, 32, 1000, 1, 1);
        const io::Image start = scene.at(0); // 10 px to the left
        CHECK(start.pixels[16 * 32 + 10] == doctest::Approx(20 / 31.0));
        CHECK(start.pixels[16 * 32 + 31] == doctest::Approx(start.pixels[16 * 32 + 12]));
    }

    TEST_CASE("the blurry frame is the mean over time, the truth its moments") {
        const Window window{3000, 5000};
        StillScene scene(waves(90, 80), moving(Path::shake, 12, 0, 4), 40, 30, 2000, 3, 3);
        EventCamera camera(ideal(), 40, 30);
        const Shot shot = expose(scene, camera, window, 4);
        REQUIRE(shot.truth.size() == 4);
        std::vector<double> mean(shot.blurry.pixels.size(), 0.0);
        const int steps = 4000;
        for (int i = 0; i < steps; ++i) {
            const io::Image frame = scene.at(3000 + 2000 * (i + 0.5) / steps);
            for (size_t k = 0; k < mean.size(); ++k) {
                mean[k] += static_cast<double>(frame.pixels[k]) / steps;
            }
        }
        double worst = 0;
        for (size_t k = 0; k < mean.size(); ++k) {
            worst = std::max(worst, std::abs(mean[k] - static_cast<double>(shot.blurry.pixels[k])));
        }
        CHECK(worst < 1e-4); // the trapezoids' error at 0.06 px a step
        for (size_t i = 0; i < 4; ++i) {
            const io::Image frame = scene.at(3000 + 2000.0 * static_cast<double>(i) / 3);
            CHECK(shot.truth[i].pixels == frame.pixels);
        }
        CHECK(truth_times(window, 1) == std::vector<double>{4000});
        CHECK_THROWS_AS(expose(scene, camera, {5, 5}, 1), std::invalid_argument);
    }

    TEST_CASE("exposures that follow one another share the camera's memory") {
        const auto run = [](std::vector<Window> windows) {
            StillScene scene(waves(90, 80), moving(Path::linear, 6), 40, 30, 10'000, 2, 1);
            EventCamera camera(CameraModel{}, 40, 30);
            for (const Window& window : windows) {
                expose(scene, camera, window, 2);
            }
            return camera.take(0);
        };
        CHECK(equal(run({{0, 10'000}, {10'000, 20'000}}), run({{0, 20'000}})));
    }

    TEST_CASE("area averages weight parts of pixels") {
        const auto row = picture(5, 1, [](int x, int) { return x; });
        const io::Image half = area_average(row, 0, 0, 2.5, 1, 2, 1);
        CHECK(half.pixels[0] == doctest::Approx((0 + 1 + 0.5 * 2) / 2.5));
        CHECK(half.pixels[1] == doctest::Approx((0.5 * 2 + 3 + 4) / 2.5));
    }

    TEST_CASE("an event camera sees the luminance of colour") {
        io::Image colour{1, 1, 3, 8, {1, 0.5F, 0}};
        CHECK(luminance(colour)[0] == doctest::Approx(0.299 + 0.5 * 0.587));
    }
}
