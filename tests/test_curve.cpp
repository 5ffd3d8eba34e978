#include <doctest/doctest.h>

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "layers/curve.hpp"
#include "layers/reference/curve.hpp"
#include "runtime/error.hpp"
#include "tests/curve_support.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

/// Lagrange basis i of the keypoints at x.
long double basis(const std::vector<float>& t, size_t i, long double x) {
    long double product = 1;
    for (size_t j = 0; j < t.size(); ++j) {
        if (j != i) {
            product *= (x - t[j]) / (static_cast<long double>(t[i]) - t[j]);
        }
    }
    return product;
}

/// The curve in 80-bit floats, and what a float32 computation may differ from it by: the errors of
/// the Lagrange bases at the nodes, of S and of the sums, each in proportion to the terms' sizes.
struct Oracle {
    long double value = 0;
    long double condition = 0; ///< |B| + sum_k |S_k| sum_i |l_i(x_k)| |y_i|
};

Oracle oracle(const std::vector<float>& t, const std::vector<float>& y, float blurry, double time) {
    const auto n = static_cast<uint32_t>(t.size());
    Oracle result{blurry, std::abs(blurry)};
    const Quadrature rule = gauss_legendre(n);
    const long double half = (static_cast<long double>(time) + 1) / 2;
    for (uint32_t q = 0; q < n; ++q) {
        for (uint32_t i = 0; i < n; ++i) {
            const long double s = rule.nodes[q];
            const long double w = rule.weights[q];
            result.value += y[i] * w * half * basis(t, i, half * (s + 1) - 1);
            result.value -= y[i] * w * 0.5L * (1 - s) * basis(t, i, s);
        }
    }
    const double times[] = {time};
    const auto matrix = curve_matrix(n, times);
    for (uint32_t k = 0; k < n; ++k) {
        for (uint32_t i = 0; i < n; ++i) {
            result.condition += std::abs(matrix[n + k] * basis(t, i, matrix[k]) * y[i]);
        }
    }
    return result;
}

/// max over t of sum_i |dL(t) / dy_i|: how far derivatives within [-1, 1] can take the curve from
/// the blurry frame, and how much an error in them grows.
double amplification(const std::vector<float>& keypoints) {
    const auto n = static_cast<uint32_t>(keypoints.size());
    std::vector<double> times;
    for (int i = -20; i <= 20; ++i) {
        times.push_back(i / 20.0);
    }
    const auto matrix = curve_matrix(n, times);
    double worst = 0;
    for (size_t f = 0; f < times.size(); ++f) {
        double sum = 0;
        for (uint32_t i = 0; i < n; ++i) {
            long double influence = 0;
            for (uint32_t k = 0; k < n; ++k) {
                influence += matrix[n + f * n + k] * basis(keypoints, i, matrix[k]);
            }
            sum += static_cast<double>(std::abs(influence));
        }
        worst = std::max(worst, sum);
    }
    return worst;
}

/// The published form in float32: monomial coefficients of the bases, integrated, by powers of t.
float monomial_curve(const std::vector<float>& t, const std::vector<float>& y, float blurry,
                     float time) {
    const size_t n = t.size();
    std::vector<float> primitive(n + 1, 0.0F);
    for (size_t i = 0; i < n; ++i) {
        std::vector<float> coefficients = {1};
        float denominator = 1;
        for (size_t j = 0; j < n; ++j) {
            if (j == i) {
                continue;
            }
            denominator *= t[i] - t[j];
            coefficients.push_back(0);
            for (size_t k = coefficients.size() - 1; k > 0; --k) {
                coefficients[k] = coefficients[k - 1] - t[j] * coefficients[k];
            }
            coefficients[0] *= -t[j];
        }
        for (size_t k = 0; k < n; ++k) {
            primitive[k + 1] += y[i] * coefficients[k] / denominator / static_cast<float>(k + 1);
        }
    }
    float value = blurry;
    float power = 1;
    for (size_t k = 0; k <= n; ++k) {
        const float mean = k % 2 == 0 ? 1 / static_cast<float>(k + 1) : 0;
        value += primitive[k] * (power - mean);
        power *= time;
    }
    return value;
}

} // namespace

TEST_SUITE("curve") {
    TEST_CASE("Gauss-Legendre integrates polynomials") {
        for (uint32_t count = 1; count <= 24; ++count) {
            const Quadrature rule = gauss_legendre(count);
            for (uint32_t degree = 0; degree < 2 * count; ++degree) {
                double sum = 0;
                for (uint32_t q = 0; q < count; ++q) {
                    sum += rule.weights[q] * std::pow(rule.nodes[q], degree);
                }
                CHECK(sum ==
                      doctest::Approx(degree % 2 == 0 ? 2.0 / (degree + 1) : 0).epsilon(1e-13));
            }
        }
    }

    TEST_CASE(
        "the error stays at float32 rounding of the terms, and the mean is the blurry frame") {
        const auto device = Device::open();
        for (uint32_t n = min_keypoints; n <= max_keypoints; ++n) {
            const Quadrature rule = gauss_legendre(n / 2 + 1); // exact for the curve, of degree n
            std::vector<double> times = rule.nodes;
            times.insert(times.end(), {-1, -0.71, 0, 0.33, 1});
            const Pixels pixels = make_pixels(n, n);
            for (const bool spaced : {false, true}) {
                if (spaced && n % 9 != 2) {
                    continue; // 2, 11 and 20 do: spacing only changes the keypoints
                }
                const auto computed = frames(*device, pixels, spaced, times);
                long double worst = 0;
                double mean_error = 0;
                for (uint32_t p = 0; p < pixels.count; ++p) {
                    const auto t = pixels.keypoints_of(p, spaced);
                    const auto y = pixels.pixel(pixels.derivatives, p);
                    double mean = 0;
                    double largest = 0;
                    for (size_t f = 0; f < times.size(); ++f) {
                        const double value = computed[f * pixels.count + p];
                        largest = std::max(largest, std::abs(value));
                        if (f < rule.nodes.size()) {
                            mean += 0.5 * rule.weights[f] * value;
                        }
                        const Oracle exact = oracle(t, y, pixels.blurry[p], times[f]);
                        worst = std::max(worst, std::abs(value - exact.value) / exact.condition);
                    }
                    mean_error = std::max(mean_error, std::abs(mean - pixels.blurry[p]) / largest);
                }
                CAPTURE(n);
                CAPTURE(spaced);
                CHECK(worst <= static_cast<long double>(n) * FLT_EPSILON);
                CHECK(mean_error <= 4 * FLT_EPSILON);
            }
        }
    }

    TEST_CASE("spacing bounds how far close keypoints can throw the curve") {
        for (const uint32_t n : {2U, 3U, 5U, 8U, 10U, 13U, 16U, 20U}) {
            CAPTURE(n);
            const auto pivots = keypoint_pivots(n);
            const double even = amplification({pivots.begin(), pivots.begin() + n});
            const Pixels pixels = make_pixels(n, 40 + n);
            double close = 0;
            for (uint32_t p = 0; p < pixels.count; ++p) {
                CHECK(amplification(pixels.keypoints_of(p, true)) <= 64 * even);
                close = std::max(close, amplification(pixels.keypoints_of(p, false)));
            }
            CHECK(close > 1000 * even); // why the paper variant spreads them
        }
    }

    TEST_CASE("spread keypoints keep their distance and the exposure") {
        const auto check = [](const std::vector<float>& t) {
            const auto spread = reference::spread_keypoints(t);
            const auto n = static_cast<uint32_t>(t.size());
            CHECK(spread.front() >= -1);
            CHECK(spread.back() <= 1);
            for (size_t i = 1; i < n; ++i) {
                CHECK(spread[i] - spread[i - 1] >= keypoint_spacing(n) - FLT_EPSILON);
            }
            return spread;
        };
        check(std::vector<float>(20, 1.0F));
        check(std::vector<float>(20, -1.0F));
        check({-0.5F, 0.99F, 0.995F, 1});
        const std::vector<float> apart = {-1, -0.2F, 0.3F, 1};
        CHECK(check(apart) == apart);
    }

    TEST_CASE("the monomial form loses digits that this one keeps") {
        const auto device = Device::open();
        constexpr uint32_t n = 10;
        const Pixels pixels = make_pixels(n, 5);
        const std::vector<double> times = {-1, -0.5, 0.25, 1};
        const auto computed = frames(*device, pixels, false, times);
        double ours = 0;
        double monomial = 0;
        for (uint32_t p = 1; p < pixels.count; p += 5) { // anywhere in their cells
            const auto t = pixels.keypoints_of(p, false);
            const auto y = pixels.pixel(pixels.derivatives, p);
            for (size_t f = 0; f < times.size(); ++f) {
                const auto exact =
                    static_cast<double>(oracle(t, y, pixels.blurry[p], times[f]).value);
                ours = std::max(ours, std::abs(computed[f * pixels.count + p] - exact));
                const float other =
                    monomial_curve(t, y, pixels.blurry[p], static_cast<float>(times[f]));
                monomial = std::max(monomial, std::abs(other - exact));
            }
        }
        MESSAGE("largest error at n = 10: ", ours, ", in monomials: ", monomial);
        CHECK(30 * ours < monomial);
    }

    TEST_CASE("keypoints at one time give finite frames") {
        const auto device = Device::open();
        Pixels pixels = make_pixels(10, 9);
        for (uint32_t p = 0; p < pixels.count; ++p) {
            pixels.keypoints[size_t{5} * pixels.count + p] =
                pixels.keypoints[size_t{4} * pixels.count + p];
        }
        for (const bool spaced : {false, true}) {
            const auto computed = frames(*device, pixels, spaced, {-1, 0, 1});
            CHECK(std::ranges::all_of(computed, [](float v) { return std::isfinite(v); }));
        }
    }

    TEST_CASE("frames larger together than the device can bind") {
        const auto device = Device::open();
        const uint64_t range = device->info().max_storage_range;
        if (range > uint64_t{256} << 20) {
            return; // nothing of a sensible size exceeds it
        }
        const Pixels pixels = make_pixels(3, 1);
        const std::vector<double> times = {-1, -0.5, 0, 0.25, 0.5, 1};
        const auto expected = frames(*device, pixels, true, times);
        Program program(*device);
        const Layout many{3, 1, pixels.count, 1, 0, 0};
        const Tensor derivatives = program.input(many);
        const Tensor keypoints = program.input(many);
        const Tensor blurry = program.input({1, 1, pixels.count, 1, 0, 0});
        const Tensor matrix = program.input(curve_matrix_layout(3, 6));
        const Layout wide{6, 1, pixels.count, 1, 0, static_cast<uint32_t>(range / 20) + 1};
        const Tensor out = program.output(wide);
        record_curve(program, derivatives, keypoints, blurry, matrix, out, {.n = 3});
        CHECK(program.steps() == 2);
        program.finish();
        program.write(derivatives, pixels.derivatives);
        program.write(keypoints, pixels.keypoints);
        program.write(blurry, pixels.blurry);
        program.write(matrix, curve_matrix(3, times));
        program.run();
        CHECK(to_dense(wide, program.read(out)) == expected);
    }

    TEST_CASE("what does not fit is refused") {
        const auto device = Device::open();
        const double outside[] = {1.001};
        CHECK_THROWS_AS(curve_matrix(10, outside), Error);
        CHECK_THROWS_AS(curve_series(10, outside), Error);
        CHECK_THROWS_AS(curve_nodes(1), Error);
        CHECK_THROWS_AS(curve_nodes(21), Error);
        Program program(*device);
        const Tensor ten = program.input({10, 2, 3, 1, 0, 0});
        const Tensor blurry = program.input({1, 2, 3, 1, 0, 0});
        const Tensor matrix = program.input(curve_matrix_layout(10, 4));
        const Tensor out = program.output({4, 2, 3, 1, 0, 0});
        const Tensor other = program.output({4, 3, 3, 1, 0, 0});
        CHECK_NOTHROW(record_curve(program, ten, ten, blurry, matrix, out, {}));
        CHECK_THROWS_AS(record_curve(program, ten, ten, blurry, matrix, other, {}), Error);
        CHECK_THROWS_AS(record_curve(program, ten, ten, blurry, matrix, out, {.n = 9}), Error);
        CHECK_THROWS_AS(
            record_curve(program, ten, ten, blurry, matrix, out, {.keypoint_channel = 1}), Error);
        const Tensor series = program.input(curve_matrix_layout(10, 4, true));
        const Tensor offsets = program.input({1, 1, 7});
        const CurveOptions ordered{.offsets = offsets};
        CHECK_NOTHROW(record_curve(program, ten, ten, blurry, series, out, ordered));
        CHECK_THROWS_AS(record_curve(program, ten, ten, blurry, matrix, out, ordered), Error);
        CHECK_THROWS_AS(record_curve(program, ten, ten, blurry, series, out, {.offsets = matrix}),
                        Error);
    }
}
