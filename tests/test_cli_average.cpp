#include <doctest/doctest.h>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

/// Trapezoid mean of the frames at even times over the exposure.
std::vector<float> mean_of(const io::Array& frames) {
    const size_t count = frames.shape[0];
    const size_t size = frames.values.size() / count;
    std::vector<double> sum(size);
    for (size_t i = 0; i < frames.values.size(); ++i) {
        const bool end = i < size || i >= (count - 1) * size;
        sum[i % size] += (end ? 0.5 : 1.0) * static_cast<double>(frames.values[i]);
    }
    std::vector<float> mean;
    for (const double value : sum) {
        mean.push_back(static_cast<float>(value / static_cast<double>(count - 1)));
    }
    return mean;
}

} // namespace

TEST_SUITE("cli average") {
    // What defines a deblurred video: its mean over the exposure is the blurry frame.
    TEST_CASE("the mean of 100 frames is the blurry frame") {
        const Scene& scene = Scene::get();
        Arguments times{"--times"};
        for (int i = 0; i < 100; ++i) {
            times.push_back(std::to_string(-1 + 2.0 * i / 99));
        }
        const io::Image blurry = io::read_image(scene.blurry);
        for (const Arguments& method :
             {kEdi, Arguments{"-m", "ecir", "--refine", "0"}, Arguments{"--refine", "0"}}) {
            CAPTURE(joined(method));
            must(scene.deblur(scene.result("mean.npy"), method + Arguments{"--overwrite"} + times));
            const io::Array frames = io::read_npy(scene.result("mean.npy"));
            CHECK(frames.shape == std::vector<size_t>{100, kHeight, kWidth});
            const double grey_levels = 255 * rms_difference(mean_of(frames), blurry.pixels);
            CAPTURE(grey_levels);
            CHECK(grey_levels < 0.5);
        }
    }
}
