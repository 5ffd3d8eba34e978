#pragma once
#include <algorithm>
#include <cstdint>
#include <optional>
#include <vector>

#include "layers/curve.hpp"
#include "layers/reference/curve.hpp"

namespace ecir::test {

inline constexpr double microsecond = 2.0 / 120000; // of a 120 ms exposure, normalised

/// Pixels side by side; value i of pixel p is [i * pixels + p].
struct Pixels {
    uint32_t n = 0;
    uint32_t count = 0;
    std::vector<float> keypoints;
    std::vector<float> derivatives;
    std::vector<float> blurry;

    [[nodiscard]] std::vector<float> pixel(const std::vector<float>& from, uint32_t p) const {
        std::vector<float> values(n);
        for (uint32_t i = 0; i < n; ++i) {
            values[i] = from[size_t{i} * count + p];
        }
        return values;
    }
    /// As the kernel sees them.
    [[nodiscard]] std::vector<float> keypoints_of(uint32_t p, bool spaced) const {
        const auto t = pixel(keypoints, p);
        return spaced ? reference::spread_keypoints(t) : t;
    }
};

/// One keypoint in each pivot's cell. A fifth of the pixels each: on the pivots; anywhere in the
/// cells; and with some neighbours 1e-2, 1e-3 or one microsecond apart across the border between
/// their cells.
inline Pixels make_pixels(uint32_t n, uint64_t seed) {
    constexpr uint32_t count = 160;
    constexpr double gaps[] = {0, 0, 1e-2, 1e-3, microsecond};
    CaseRandom random(seed);
    Pixels pixels{n, count, std::vector<float>(size_t{n} * count),
                  random.values(size_t{n} * count, -4, 4), random.values(count, 0, 1)};
    const double cell = 2.0 / (n - 1.0);
    for (uint32_t p = 0; p < count; ++p) {
        const uint32_t kind = p % 5;
        std::vector<double> t(n);
        for (uint32_t i = 0; i < n; ++i) {
            const double within = kind == 0 ? 0 : random.uniform(-0.499, 0.499);
            t[i] = std::clamp(-1 + cell * (i + within), -1.0, 1.0);
        }
        for (uint32_t i = 1; i < n && kind >= 2; ++i) {
            // A keypoint takes part in one pair only, as it has one place in its cell.
            if (n == 2 || random.integer(0, 2) == 0) {
                const double border = -1 + cell * (i - 0.5);
                t[i - 1] = border - gaps[kind] / 2;
                t[i] = border + gaps[kind] / 2;
                ++i;
            }
        }
        for (uint32_t i = 0; i < n; ++i) {
            pixels.keypoints[size_t{i} * count + p] = static_cast<float>(t[i]);
        }
    }
    return pixels;
}

/// Frames by the kernel: frame f of pixel p at [f * pixels + p]. offsets: of the events that the
/// order follows, none for the full order.
inline std::vector<float> frames(Device& device, const Pixels& pixels, bool spaced,
                                 const std::vector<double>& times,
                                 const std::vector<uint32_t>& offsets = {}) {
    const bool ordered = !offsets.empty();
    const auto d = static_cast<uint32_t>(times.size());
    Program program(device);
    const Layout many{pixels.n, 1, pixels.count, 1, 0, 0};
    const Tensor derivatives = program.input(many);
    const Tensor keypoints = program.input(many);
    const Tensor blurry = program.input({1, 1, pixels.count, 1, 0, 0});
    const Tensor matrix = program.input(curve_matrix_layout(pixels.n, d, ordered));
    const Tensor offset_input = program.input({1, 1, pixels.count + 1});
    const Tensor out = program.output({d, 1, pixels.count, 1, 0, 0});
    record_curve(program, derivatives, keypoints, blurry, matrix, out,
                 {.n = pixels.n,
                  .spaced = spaced,
                  .offsets = ordered ? std::optional(offset_input) : std::nullopt});
    program.finish();
    program.write(derivatives, pixels.derivatives);
    program.write(keypoints, pixels.keypoints);
    program.write(blurry, pixels.blurry);
    program.write(matrix, ordered ? curve_series(pixels.n, times) : curve_matrix(pixels.n, times));
    program.write(offset_input, offsets);
    program.run();
    const auto memory = program.read(out);
    return {memory.begin(), memory.end()};
}

} // namespace ecir::test
