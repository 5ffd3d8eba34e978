#pragma once
#include <algorithm>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "layers/method.hpp"
#include "runtime/error.hpp"
#include "weights/safetensors.hpp"

namespace ecir::test {

/// The code of the Error that an action throws, or ok.
ExitCode code_of(const auto& action) {
    try {
        action();
    } catch (const Error& error) {
        return error.code();
    }
    return ExitCode::ok;
}

inline bool all_finite(std::span<const float> values) {
    return std::ranges::all_of(values, [](float value) { return std::isfinite(value); });
}

/// A file of tests/fixtures (tools/train/make_fixtures.py): weights, an input, and the frames that
/// PyTorch computed from them in float64.
struct Fixture {
    SafeTensors file;
    uint32_t height;
    uint32_t width;
    Events events;
    Exposure exposure;
    std::vector<double> times;

    explicit Fixture(const std::string& name)
        : file(std::string(ECIR_TEST_DATA) + "/fixtures/" + name + ".safetensors"),
          height(file.get("input.blurry").shape[0]), width(file.get("input.blurry").shape[1]) {
        const auto& t = file.get("input.t").values;
        for (size_t i = 0; i < t.size(); ++i) {
            events.push_back(static_cast<int64_t>(t[i]),
                             static_cast<uint16_t>(file.get("input.x").values[i]),
                             static_cast<uint16_t>(file.get("input.y").values[i]),
                             static_cast<uint8_t>(file.get("input.p").values[i]));
        }
        exposure = {static_cast<int64_t>(file.get("input.exposure").values[0]),
                    static_cast<int64_t>(file.get("input.exposure").values[1])};
        // linspace(-1, 1, d), which the file holds rounded to float32.
        const auto count = file.get("input.times").values.size();
        for (size_t i = 0; i < count; ++i) {
            times.push_back(-1 + 2 * static_cast<double>(i) / static_cast<double>(count - 1));
        }
    }

    [[nodiscard]] FrameInput input() const {
        return {file.get("input.blurry").values, events.view(), exposure, times};
    }

    /// Largest difference to the file's frames, which hold every `stride`-th pixel of as many rows.
    [[nodiscard]] double difference(std::span<const float> frames, const std::string& name,
                                    size_t stride) const {
        const auto& expected = file.get(name);
        double largest = 0;
        size_t i = 0;
        for (size_t d = 0; d < expected.shape[0]; ++d) {
            for (size_t y = 0; y < height; y += stride) {
                for (size_t x = 0; x < width; x += stride) {
                    const double difference = std::abs(
                        double{frames[(d * height + y) * width + x]} - expected.values[i++]);
                    largest = std::isfinite(difference) ? std::max(largest, difference) : INFINITY;
                }
            }
        }
        return i == expected.values.size() ? largest : INFINITY;
    }
};

} // namespace ecir::test
