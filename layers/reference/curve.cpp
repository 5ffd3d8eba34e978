#include "layers/reference/curve.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "layers/curve.hpp"

namespace ecir {
namespace {

struct Case {
    uint32_t width, height;
    uint32_t n, d;
    bool spaced;
    uint32_t input_block; ///< 0 for the device's
    uint32_t halo;
    uint32_t offset; ///< of the first channel in every input
};

/// The last one: as in the network.
constexpr std::array<Case, 13> cases = {{
    {1, 1, 2, 1, true, 1, 0, 0},
    {1, 1, 10, 14, false, 8, 1, 1},
    {17, 5, 2, 3, false, 1, 0, 0},
    {17, 5, 3, 1, true, 8, 1, 1},
    {64, 3, 5, 14, true, 8, 1, 0},
    {65, 3, 10, 14, true, 8, 1, 1},
    {33, 9, 10, 14, false, 8, 1, 1},
    {33, 9, 10, 40, true, 4, 2, 3},
    {19, 7, 13, 16, false, 1, 1, 0},
    {19, 7, 16, 17, true, 16, 1, 1},
    {130, 2, 20, 14, true, 8, 1, 1},
    {31, 4, 20, 33, false, 8, 0, 1},
    {240, 180, 10, 14, true, 0, 2, 0},
}};

/// One keypoint in each pivot's cell.
std::vector<float> case_keypoints(CaseRandom& random, uint32_t n, uint32_t trial) {
    std::vector<float> keypoints(n);
    const auto pivots = keypoint_pivots(n);
    for (uint32_t i = 0; i < n; ++i) {
        // The whole cell where keypoints get spread; elsewhere its middle, so that the polynomial
        // stays as tame as the tolerance wants.
        const double reach = (trial % 2 == 0 ? 0.9 : 0.3) / (n - 1.0);
        keypoints[i] = random.integer(0, 3) == 0
                           ? pivots[i]
                           : static_cast<float>(
                                 std::clamp(pivots[i] + random.uniform(-reach, reach), -1.0, 1.0));
    }
    return keypoints;
}

} // namespace

std::vector<float> reference::spread_keypoints(std::span<const float> keypoints) {
    std::vector<float> t(keypoints.begin(), keypoints.end());
    const auto n = t.size();
    const float spacing = keypoint_spacing(static_cast<uint32_t>(n));
    for (size_t i = 1; i < n; ++i) {
        t[i] = std::max(t[i], t[i - 1] + spacing);
    }
    if (t[n - 1] > 1) {
        t[n - 1] = 1;
        for (size_t i = n - 1; i > 0; --i) {
            t[i - 1] = std::min(t[i - 1], t[i] - spacing);
        }
    }
    return t;
}

double reference::curve(std::span<const float> keypoints, std::span<const float> derivatives,
                        double blurry, double t, uint32_t order) {
    const auto whole = [&](double s) {
        double sum = 0;
        for (size_t i = 0; i < keypoints.size(); ++i) {
            double term = derivatives[i];
            for (size_t j = 0; j < keypoints.size(); ++j) {
                if (j != i) {
                    term *= (s - keypoints[j]) / (double{keypoints[i]} - keypoints[j]);
                }
            }
            sum += term;
        }
        return sum;
    };
    const Quadrature rule = gauss_legendre(static_cast<uint32_t>(keypoints.size()));
    std::vector<double> series; // shares of the Legendre polynomials that are kept
    if (order < keypoints.size()) {
        for (uint32_t j = 0; j < order; ++j) {
            double share = 0;
            for (size_t q = 0; q < rule.nodes.size(); ++q) {
                share += (j + 0.5) * rule.weights[q] * std::legendre(j, rule.nodes[q]) *
                         whole(rule.nodes[q]);
            }
            series.push_back(share);
        }
    }
    const auto derivative = [&](double s) {
        if (order >= keypoints.size()) {
            return whole(s);
        }
        double sum = 0;
        for (uint32_t j = 0; j < order; ++j) {
            sum += series[j] * std::legendre(j, s);
        }
        return sum;
    };
    double primitive = 0;
    double mean = 0; // half the integral of the primitive, by parts
    for (size_t q = 0; q < rule.nodes.size(); ++q) {
        const double half = (t + 1) / 2;
        primitive += half * rule.weights[q] * derivative(half * (rule.nodes[q] + 1) - 1);
        mean += 0.5 * rule.weights[q] * (1 - rule.nodes[q]) * derivative(rule.nodes[q]);
    }
    return blurry + primitive - mean;
}

namespace {

/// Events of some pixels in every other square of 24 x 24, as PackedEvents::offset.
std::vector<uint32_t> case_offsets(CaseRandom& random, uint32_t width, uint32_t pixels) {
    std::vector<uint32_t> offsets{0};
    for (uint32_t p = 0; p < pixels; ++p) {
        const bool still = (p % width / 24 + p / width / 24) % 2 == 1;
        const bool quiet = still || random.integer(0, 9) < 8;
        offsets.push_back(offsets.back() + (quiet ? 0 : random.integer(1, 4)));
    }
    return offsets;
}

/// min(n, events of the 3 x 3 pixels around pixel p).
uint32_t order_at(const std::vector<uint32_t>& offsets, const Case& shape, uint32_t p) {
    uint32_t events = 0;
    for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
            const int x = static_cast<int>(p % shape.width) + dx;
            const int y = static_cast<int>(p / shape.width) + dy;
            if (x >= 0 && y >= 0 && x < static_cast<int>(shape.width) &&
                y < static_cast<int>(shape.height)) {
                const size_t at = static_cast<size_t>(y) * shape.width + static_cast<size_t>(x);
                events += offsets[at + 1] - offsets[at];
            }
        }
    }
    return std::min(events, shape.n);
}

Trial trial_of(Device& device, uint32_t trial, bool ordered) {
    const Case& shape = cases.at(trial);
    const uint32_t n = shape.n;
    const uint32_t pixels = shape.width * shape.height;
    const uint32_t channels = shape.offset + n;
    CaseRandom random(300 + trial);

    std::vector<double> times(shape.d);
    for (uint32_t i = 0; i < shape.d; ++i) {
        times[i] = shape.d == 1 ? 0 : 2.0 * i / (shape.d - 1.0) - 1;
    }
    // Channels that the kernel must not read hold large values.
    std::vector<float> keypoints(size_t{channels} * pixels, 1e6F);
    auto derivatives = random.values(size_t{channels} * pixels, -1, 1);
    auto blurry = random.values(size_t{shape.offset + 1} * pixels, 0, 1);
    std::fill_n(derivatives.begin(), size_t{shape.offset} * pixels, 1e6F);
    std::fill_n(blurry.begin(), size_t{shape.offset} * pixels, 1e6F);

    const auto offsets = case_offsets(random, shape.width, pixels);

    Trial result;
    result.reference.resize(size_t{shape.d} * pixels);
    for (uint32_t p = 0; p < pixels; ++p) {
        const std::vector<float> t = case_keypoints(random, n, trial);
        std::vector<float> y(n);
        for (uint32_t i = 0; i < n; ++i) {
            const size_t index = size_t{shape.offset + i} * pixels + p;
            keypoints[index] = t[i];
            y[i] = derivatives[index];
        }
        const std::vector<float> used = shape.spaced ? reference::spread_keypoints(t) : t;
        for (uint32_t i = 0; i < shape.d; ++i) {
            result.reference[size_t{i} * pixels + p] =
                reference::curve(used, y, blurry[size_t{shape.offset} * pixels + p], times[i],
                                 ordered ? order_at(offsets, shape, p) : max_keypoints);
        }
    }

    result.shape = "n " + std::to_string(n) + (shape.spaced ? " spaced, " : ", ") +
                   std::to_string(shape.d) + " frames " + std::to_string(shape.width) + "x" +
                   std::to_string(shape.height);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const uint32_t block = case_block(device, shape.input_block);
    const Layout many{channels, shape.height, shape.width, block, shape.halo, 0};
    Layout one = many;
    one.channels = shape.offset + 1;
    const Tensor derivative_input = program.input(many);
    const Tensor keypoint_input = program.input(many);
    const Tensor blurry_input = program.input(one);
    const Tensor matrix = program.input(curve_matrix_layout(n, shape.d, ordered));
    const Tensor offset_input = program.input({1, 1, pixels + 1});
    result.output = program.output({shape.d, shape.height, shape.width, 1, shape.halo, 0});
    program.clear(result.output);
    result.first_step = program.steps();
    record_curve(program, derivative_input, keypoint_input, blurry_input, matrix, result.output,
                 {n, shape.spaced, shape.offset, shape.offset, shape.offset,
                  ordered ? std::optional(offset_input) : std::nullopt});
    program.finish();
    program.write(derivative_input, from_dense(many, derivatives));
    program.write(keypoint_input, from_dense(many, keypoints));
    program.write(blurry_input, from_dense(one, blurry));
    program.write(matrix, ordered ? curve_series(n, times) : curve_matrix(n, times));
    program.write(offset_input, offsets);
    return result;
}

} // namespace

Trial curve_trial(Device& device, uint32_t trial) {
    return trial_of(device, trial, false);
}

Trial curve_order_trial(Device& device, uint32_t trial) {
    return trial_of(device, trial, true);
}

} // namespace ecir
