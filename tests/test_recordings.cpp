#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <opencv2/imgproc.hpp>

#include "layers/deblur.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/image.hpp"
#include "tools/io/recording.hpp"

// Real recordings, where they are at hand: ECIR_TEST_RECORDINGS names the folder that holds
// real/davis346_cups_a, 346x260 pixels, 104 ms exposures by a shaking hand. They may not be
// shipped.
namespace {

namespace fs = std::filesystem;
using namespace ecir;

fs::path cups() {
    const char* folder = std::getenv("ECIR_TEST_RECORDINGS");
    return folder == nullptr ? fs::path() : fs::path(folder) / "real" / "davis346_cups_a";
}

/// Root mean square, in grey levels of 255, of what separates the frames' trapezoid mean from
/// `blurry`.
double mean_difference(std::span<const float> frames, std::span<const float> blurry, size_t count) {
    const size_t pixels = blurry.size();
    double sum = 0;
    for (size_t i = 0; i < pixels; ++i) {
        double mean = 0;
        for (size_t k = 0; k < count; ++k) {
            const double weight = k == 0 || k + 1 == count ? 0.5 : 1;
            mean += weight * double{frames[k * pixels + i]} / static_cast<double>(count - 1);
        }
        sum += (mean - blurry[i]) * (mean - blurry[i]);
    }
    return 255 * std::sqrt(sum / static_cast<double>(pixels));
}

/// How steep the strongest edges are: the 98th percentile of the differences two pixels apart,
/// along rows and columns, of 3x3 averages (the sensor's own stripes are a pixel wide).
double edge_steepness(std::span<const float> frame, int width, int height) {
    const cv::Mat image(height, width, CV_32F, const_cast<float*>(frame.data()));
    cv::Mat smooth;
    cv::blur(image, smooth, {3, 3});
    std::vector<float> differences;
    for (int y = 2; y < height; ++y) {
        for (int x = 2; x < width; ++x) {
            const float here = smooth.at<float>(y, x);
            differences.push_back(std::abs(here - smooth.at<float>(y, x - 2)));
            differences.push_back(std::abs(here - smooth.at<float>(y - 2, x)));
        }
    }
    const auto place =
        differences.begin() + static_cast<std::ptrdiff_t>(differences.size() * 98 / 100);
    std::ranges::nth_element(differences, place);
    return *place;
}

} // namespace

TEST_SUITE("recordings") {
    TEST_CASE("real frames: the mean of the sharp frames is the blurry one, and they are sharper") {
        if (!fs::is_directory(cups())) {
            MESSAGE("no recordings here; set ECIR_TEST_RECORDINGS to run this");
            return;
        }
        const auto device = Device::open();
        const io::Recording recording = io::open_recording(cups());
        REQUIRE(recording.items.size() == 19);
        const io::EventFile events = io::read_events(recording.events);

        DeblurOptions curve;
        curve.refine = 0;
        DeblurOptions edi;
        edi.model = "edi";
        for (const DeblurOptions& options : {curve, edi}) {
            CAPTURE(options.model);
            Deblur deblur(device, options, 346, 260);
            for (size_t i = 0; i < recording.items.size(); i += 6) {
                const auto& item = recording.items[i];
                CAPTURE(item.name);
                const auto blurry = io::luminance(recording.read(item));
                constexpr uint32_t kFrames = 100;
                const auto frames =
                    deblur.frames(blurry, events.events.view(), item.exposure, even_times(kFrames));
                CHECK(mean_difference(frames, blurry, kFrames) < 0.5);
                const auto middle = std::span<const float>(frames).subspan(
                    kFrames / 2 * blurry.size(), blurry.size());
                CHECK(edge_steepness(middle, 346, 260) > 1.1 * edge_steepness(blurry, 346, 260));
            }
        }
    }

    TEST_CASE("the shipped model on real frames stays within what a picture can be") {
        if (!fs::is_directory(cups())) {
            MESSAGE("no recordings here; set ECIR_TEST_RECORDINGS to run this");
            return;
        }
        const io::Recording recording = io::open_recording(cups());
        const io::EventFile events = io::read_events(recording.events);
        Deblur deblur(Device::open(), {}, 346, 260);
        for (size_t i = 0; i < recording.items.size(); i += 9) {
            const auto blurry = io::luminance(recording.read(recording.items[i]));
            const auto frames = deblur.frames(blurry, events.events.view(),
                                              recording.items[i].exposure, even_times(5));
            for (size_t k = 0; k < 5; ++k) {
                const auto frame =
                    std::span<const float>(frames).subspan(k * blurry.size(), blurry.size());
                CHECK(edge_steepness(frame, 346, 260) > 1.1 * edge_steepness(blurry, 346, 260));
                size_t beyond = 0;
                for (const float value : frame) {
                    beyond += std::isfinite(value) && value > -0.1F && value < 1.1F ? 0 : 1;
                }
                CHECK(static_cast<double>(beyond) < 0.001 * static_cast<double>(frame.size()));
            }
        }
    }
}
