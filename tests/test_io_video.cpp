#include <cmath>
#include <cstdint>
#include <doctest/doctest.h>
#include <filesystem>
#include <limits>
#include <opencv2/videoio.hpp>
#include <string>

#include "tests/test_io_support.hpp"
#include "tools/io/image.hpp"
#include "tools/io/video.hpp"

using namespace ecir;
using namespace ecir::test;
namespace fs = std::filesystem;

namespace {

/// Grey ramp with a bright last column and row, so that a lost edge is noticed.
io::Image ramp(int width, int height, int channels, float level) {
    io::Image image{width, height, channels, 8, {}};
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const bool edge = x >= width - 3 || y >= height - 3;
            image.pixels.insert(image.pixels.end(), static_cast<size_t>(channels),
                                edge ? 1.0F : level);
        }
    }
    return image;
}

void check_video(const std::string& name, int width, int height, bool colour) {
    CAPTURE(name);
    const TemporaryFolder folder;
    io::VideoWriter video(folder / name, width, height, 33.5, colour);
    for (int i = 0; i < 7; ++i) {
        video.write(ramp(width, height, colour ? 3 : 1, static_cast<float>(i) / 10.0F));
    }
    CHECK_NOTHROW(video.close());
    cv::VideoCapture again(folder / name, cv::CAP_FFMPEG);
    CHECK(std::abs(again.get(cv::CAP_PROP_FPS) - 33.5) < 0.01);
    cv::Mat frame;
    for (int i = 0; i < 7; ++i) {
        CAPTURE(i);
        REQUIRE(again.read(frame));
        REQUIRE(frame.cols == width + width % 2);
        REQUIRE(frame.rows == height + height % 2);
        CHECK(std::abs(frame.at<cv::Vec3b>(2, 2)[0] - 25.5 * i) < 8);
        CHECK(frame.at<cv::Vec3b>(height - 1, width - 1)[1] > 225);
        CHECK(frame.at<cv::Vec3b>(frame.rows - 1, frame.cols - 1)[1] > 225);
    }
    CHECK_FALSE(again.read(frame));
}

io::Image noise(int width, int height, uint32_t seed) {
    io::Image image{width, height, 1, 8, {}};
    for (int i = 0; i < width * height; ++i) {
        seed = seed * 1664525U + 1013904223U;
        image.pixels.push_back(static_cast<float>(seed >> 8U) / 16777216.0F);
    }
    return image;
}

} // namespace

TEST_SUITE("io") {

    TEST_CASE("video: odd sizes are padded and nothing is lost") {
        for (const auto* name : {"a.mp4", "a.mkv", "a.avi"}) {
            check_video(name, 173, 131, false);
        }
        check_video("a.MP4", 17, 16, true);
    }

    TEST_CASE("video: even sizes and colour") {
        for (const auto* name : {"a.mp4", "a.mkv", "a.avi"}) {
            check_video(name, 64, 48, true);
        }
        check_video("a.mp4", 16, 16, false);
    }

    TEST_CASE("video: colours are in RGB order, values are clipped") {
        const TemporaryFolder folder;
        io::VideoWriter video(folder / "a.mp4", 32, 32, 10, true);
        io::Image image{32, 32, 3, 8, {}};
        for (int i = 0; i < 32 * 32; ++i) {
            image.pixels.insert(image.pixels.end(), {1.5F, -2.0F, 0.0F});
        }
        video.write(image);
        video.close();
        cv::VideoCapture again(folder / "a.mp4", cv::CAP_FFMPEG);
        cv::Mat frame;
        REQUIRE(again.read(frame));
        CHECK(frame.at<cv::Vec3b>(9, 9)[2] > 240);
        CHECK(frame.at<cv::Vec3b>(9, 9)[0] < 15);
    }

    TEST_CASE("video: frame rates from slow to very fast") {
        const TemporaryFolder folder;
        for (const auto* name : {"a.mp4", "a.mkv", "a.avi"}) {
            for (const double fps : {0.5, 134.6153846, 28000.0}) {
                CAPTURE(name);
                CAPTURE(fps);
                io::VideoWriter video(folder / name, 32, 32, fps, false);
                for (int i = 0; i < 3; ++i) {
                    video.write(ramp(32, 32, 1, 0.3F));
                }
                CHECK_NOTHROW(video.close());
            }
        }
    }

    TEST_CASE("video: unsuitable sizes, rates, names and frames are errors") {
        const TemporaryFolder folder;
        using io::VideoWriter;
        check_error(
            ExitCode::bad_input, [&] { VideoWriter(folder / "a.gif", 32, 32, 30, true); }, ".gif");
        check_error(ExitCode::bad_input, [&] { VideoWriter(folder / "a.mp4", 0, 32, 30, true); });
        check_error(ExitCode::bad_input, [&] {
            VideoWriter(folder / "a.mp4", 32, 32, std::numeric_limits<double>::quiet_NaN(), true);
        });
        check_error(
            ExitCode::bad_input, [&] { VideoWriter(folder / "no/a.mp4", 32, 32, 30, true); },
            "no/a.mp4");
        VideoWriter video(folder / "a.mp4", 32, 32, 30, false);
        check_error(
            ExitCode::bad_input, [&] { video.write(ramp(32, 30, 1, 0)); }, "32 x 30");
        check_error(
            ExitCode::bad_input, [&] { video.write(ramp(32, 32, 3, 0)); }, "3 channels");
        CHECK(io::is_video("x.MKV"));
        CHECK_FALSE(io::is_video("x.npy"));
    }

    TEST_CASE("video: a full disk is exit 5") {
        for (const std::string name : {"full.mp4", "full.mkv", "full.avi"}) {
            const TemporaryFolder folder;
            fs::create_symlink("/dev/full", folder / name);
            check_error(
                ExitCode::resources, [&] { io::VideoWriter(folder / name, 64, 64, 30, false); },
                name, "space");
            CHECK(fs::is_symlink(folder / name));
        }
    }

    TEST_CASE("video: a disk that fills up meanwhile is exit 5") {
        for (const auto* name : {"a.mp4", "a.mkv", "a.avi"}) {
            const TemporaryFolder folder;
            const FileSizeLimit limit(70000);
            check_error(
                ExitCode::resources,
                [&] {
                    io::VideoWriter video(folder / name, 173, 131, 30, false);
                    for (int k = 0; k < 20; ++k) {
                        video.write(noise(173, 131, static_cast<uint32_t>(k)));
                    }
                    video.close();
                },
                name, "space");
        }
    }

} // TEST_SUITE
