#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <stdexcept>
#include <utility>
#include <vector>

#include "tools/ecir/metrics.hpp"

using namespace ecir::metrics;

namespace {

/// The pictures of tests/eval_reference.py.
std::pair<Frame, Frame> pictures(int width, int height, int channels, int strength) {
    Frame truth{width, height, channels, {}};
    Frame prediction = truth;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            for (int c = 0; c < channels; ++c) {
                const int value = (3 * x + 5 * y + 4 * (x * y % 17) + 60 * c) % 256;
                const int noise = (7 * x + 11 * y + x * y + 5 * c) % 23 - 11;
                truth.values.push_back(static_cast<uint8_t>(value));
                prediction.values.push_back(
                    static_cast<uint8_t>(std::clamp(value + strength * noise, 0, 255)));
            }
        }
    }
    return {truth, prediction};
}

Frame flat(uint8_t value) {
    return {8, 8, 1, std::vector<uint8_t>(64, value)};
}

} // namespace

TEST_SUITE("eval") {
    TEST_CASE("the figures are scikit-image's") {
        struct Expected {
            int width, height, channels, strength;
            double nrmse, psnr, ssim;
        };
        // Printed by tests/eval_reference.py with scikit-image 0.19.3.
        const std::vector<Expected> cases{
            {32, 24, 1, 1, 0.046355, 31.796251, 0.964427},
            {7, 7, 1, 2, 0.247227, 25.835187, 0.902231},
            {13, 29, 1, 6, 0.299932, 16.490109, 0.427815},
            {20, 15, 3, 3, 0.126015, 22.308099, 0.784367},
        };
        for (const Expected& expected : cases) {
            CAPTURE(expected.width);
            const auto [truth, prediction] =
                pictures(expected.width, expected.height, expected.channels, expected.strength);
            const Figures figures = compare(truth, prediction);
            CHECK(std::abs(figures.nrmse - expected.nrmse) < 2e-6);
            CHECK(std::abs(figures.psnr - expected.psnr) < 2e-6);
            CHECK(std::abs(figures.ssim - expected.ssim) < 2e-6);
        }
    }

    TEST_CASE("identical frames have infinite PSNR, which the mean keeps") {
        const auto [truth, prediction] = pictures(16, 16, 1, 1);
        const std::vector<Figures> figures{compare(truth, truth), compare(truth, prediction)};
        CHECK(std::isinf(figures[0].psnr));
        CHECK(figures[0].nrmse == 0);
        CHECK(figures[0].ssim == doctest::Approx(1));
        const Figures both = mean(figures);
        CHECK(std::isinf(both.psnr));
        CHECK(both.nrmse == doctest::Approx(figures[1].nrmse / 2));
        CHECK(both.ssim == doctest::Approx((1 + figures[1].ssim) / 2));
    }

    TEST_CASE("black against white, and a black truth") {
        const Figures worst = compare(flat(255), flat(0));
        CHECK(worst.nrmse == doctest::Approx(1));
        CHECK(worst.psnr == doctest::Approx(0));
        CHECK(worst.ssim == doctest::Approx(6.5025 / (65025 + 6.5025))); // C1 / (255^2 + C1)
        CHECK(std::isinf(compare(flat(0), flat(1)).nrmse));
        CHECK(compare(flat(0), flat(0)).nrmse == 0);
    }

    TEST_CASE("floats are clipped and truncated") {
        const std::vector<float> values{-1.0F,        0.0F, 0.9F / 255, 1.0F / 255,
                                        127.9F / 255, 1.0F, 2.0F};
        CHECK(to_8_bit(values) == std::vector<uint8_t>{0, 0, 0, 1, 127, 255, 255});
        for (int i = 0; i < 256; ++i) {
            const std::vector<float> exact{static_cast<float>(i) / 255.0F};
            CHECK(to_8_bit(exact)[0] == i);
        }
    }

    TEST_CASE("shapes that differ or are too small are refused") {
        CHECK_THROWS_AS(compare(pictures(8, 8, 1, 1).first, pictures(9, 8, 1, 1).first),
                        std::invalid_argument);
        CHECK_THROWS_AS(compare(pictures(8, 8, 1, 1).first, pictures(8, 8, 3, 1).first),
                        std::invalid_argument);
        const Frame narrow = pictures(6, 20, 1, 1).first;
        CHECK_THROWS_AS(compare(narrow, narrow), std::invalid_argument);
    }
}
