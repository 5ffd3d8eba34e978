#include <algorithm>
#include <cfloat>
#include <cmath>
#include <cstdio>

#include "layers/curve.hpp"
#include "layers/reference/curve.hpp"
#include "tools/simulate/random.hpp"
#include "tools/stability/interpolation.hpp"
#include "tools/stability/sweep.hpp"

// The curve's arithmetic: what float32 loses in each form of it, and what the problem itself does
// to an error of the derivatives.

namespace ecir::stability {
namespace {

constexpr double kMicrosecond = 2.0 / 120'000; ///< of a 120 ms exposure, normalised
constexpr float kSteepest = 4;                 ///< |dL/dt| over half an exposure
constexpr uint32_t kShipped = 10;              ///< keypoints of the shipped network
constexpr uint32_t kPixels = 32;
constexpr double kLevel = 1.0 / 255;

/// Keypoints on the pivots, but neighbours in pairs `gap` apart about the borders of their cells.
std::vector<float> paired_keypoints(uint32_t n, double gap) {
    const double cell = 2.0 / (n - 1);
    std::vector<float> t(n);
    for (uint32_t i = 0; i < n; ++i) {
        t[i] = static_cast<float>(-1 + cell * i);
    }
    for (uint32_t i = 0; i + 1 < n; i += 2) {
        const double border = -1 + cell * (i + 0.5);
        t[i] = static_cast<float>(border - gap / 2);
        t[i + 1] = static_cast<float>(border + gap / 2);
    }
    return t;
}

double even_gap(uint32_t n) {
    return 2.0 / (n - 1);
}

std::vector<Knots> pixels_of(uint32_t n, double gap) {
    sim::Random random(n, 91);
    std::vector<Knots> pixels;
    for (uint32_t p = 0; p < kPixels; ++p) {
        Knots knots{paired_keypoints(n, std::min(gap, even_gap(n))), {}};
        for (uint32_t i = 0; i < n; ++i) {
            knots.y.push_back(static_cast<float>(random.uniform(-kSteepest, kSteepest)));
        }
        pixels.push_back(std::move(knots));
    }
    return pixels;
}

std::vector<float> times_of() {
    std::vector<float> times;
    for (int i = 0; i <= 28; ++i) {
        times.push_back(static_cast<float>(i) / 14 - 1);
    }
    return times;
}

/// The frames of all pixels, blurry value 0, by the kernel: [pixel][time].
std::vector<std::vector<float>> kernel_curves(Device& device, const std::vector<Knots>& pixels,
                                              std::span<const float> times, bool spaced) {
    const auto n = static_cast<uint32_t>(pixels.front().size());
    const auto count = static_cast<uint32_t>(pixels.size());
    const auto d = static_cast<uint32_t>(times.size());
    Program program(device);
    const Layout many{n, 1, count};
    const Tensor derivatives = program.input(many);
    const Tensor keypoints = program.input(many);
    const Tensor blurry = program.input({1, 1, count});
    const Tensor matrix = program.input(curve_matrix_layout(n, d));
    const Tensor frames = program.output({d, 1, count});
    record_curve(program, derivatives, keypoints, blurry, matrix, frames,
                 {.n = n, .spaced = spaced});
    program.finish();
    std::vector<float> y(size_t{n} * count);
    std::vector<float> t(y.size());
    for (size_t p = 0; p < count; ++p) {
        for (size_t i = 0; i < n; ++i) {
            y[i * count + p] = pixels[p].y[i];
            t[i * count + p] = pixels[p].t[i];
        }
    }
    program.write(derivatives, y);
    program.write(keypoints, t);
    program.write(blurry, std::vector<float>(count));
    program.write(matrix, curve_matrix(n, std::vector<double>(times.begin(), times.end())));
    program.run();
    const auto values = program.read(frames);
    std::vector<std::vector<float>> curves(count);
    for (size_t f = 0; f < d; ++f) {
        for (size_t p = 0; p < count; ++p) {
            curves[p].push_back(values[f * count + p]);
        }
    }
    return curves;
}

/// Largest error over pixels and times, grey levels.
struct Errors {
    double largest = 0;
    bool finite = true;
    void add(float value, double exact) {
        finite = finite && std::isfinite(value);
        largest = std::max(largest, std::abs(value - exact) / kLevel);
    }
};

/// Float32 promises no more than n rounding errors of the largest sum's terms.
double theory_levels(uint32_t n, double constant) {
    return n * double{FLT_EPSILON} * constant * kSteepest / kLevel;
}

Sample judged(const std::string& name, const Errors& errors, double bound, double constant) {
    Sample sample{.series = name, .value = errors.largest, .finite = errors.finite};
    if (!errors.finite || errors.largest > std::max(1.0, bound)) {
        sample.failed = true;
        char text[128];
        std::snprintf(text, sizeof text, "%.2g grey levels off, where Lebesgue's %.2g allows %.2g",
                      errors.largest, constant, bound);
        sample.how = errors.finite ? text : "a value that is not finite";
        // Only the shipped form answers for its values; the others are there to compare with.
        sample.finite = sample.finite || !name.starts_with("ecir");
    }
    return sample;
}

Sample theory(double value) {
    return {.series = "theory: n eps Lebesgue", .value = value, .reference = true};
}

struct Named {
    const char* name;
    Form form;
};

std::vector<Sample> derivative_errors(uint32_t n, double gap) {
    const auto pixels = pixels_of(n, gap);
    const auto times = times_of();
    const double constant = lebesgue_constant(pixels.front().t);
    const double bound = theory_levels(n, constant);
    std::vector<Sample> samples = {theory(bound)};
    for (const auto& [name, form] : {Named{"monomials (published)", monomial_derivative},
                                     {"barycentric", barycentric_derivative},
                                     {"divided differences", newton_derivative},
                                     {"Legendre basis", legendre_derivative},
                                     {"ecir: products", lagrange_derivative}}) {
        Errors errors;
        for (const Knots& knots : pixels) {
            const auto values = form(knots, times);
            for (size_t i = 0; i < times.size(); ++i) {
                errors.add(values[i], exact_derivative(knots, times[i]));
            }
        }
        samples.push_back(judged(name, errors, bound, constant));
    }
    return samples;
}

std::vector<Sample> curve_errors(const Lab& lab, uint32_t n, double gap) {
    const auto pixels = pixels_of(n, gap);
    const auto times = times_of();
    const double constant = curve_amplification(pixels.front().t);
    const double bound = theory_levels(n, constant);
    std::vector<Sample> samples = {theory(bound)};
    std::vector<std::vector<double>> exact;
    for (const Knots& knots : pixels) {
        exact.emplace_back();
        for (const float time : times) {
            exact.back().push_back(reference::curve(knots.t, knots.y, 0, time));
        }
    }
    for (const auto& [name, form] : {Named{"monomials (published)", monomial_curve},
                                     {"barycentric", barycentric_curve},
                                     {"divided differences", newton_curve},
                                     {"Legendre basis", legendre_curve}}) {
        Errors errors;
        for (size_t p = 0; p < pixels.size(); ++p) {
            const auto values = form(pixels[p], times);
            for (size_t i = 0; i < times.size(); ++i) {
                errors.add(values[i], exact[p][i]);
            }
        }
        samples.push_back(judged(name, errors, bound, constant));
    }
    for (const bool spaced : {false, true}) {
        const auto curves = kernel_curves(*lab.device, pixels, times, spaced);
        Errors errors;
        for (size_t p = 0; p < pixels.size(); ++p) {
            const auto t = spaced ? reference::spread_keypoints(pixels[p].t) : pixels[p].t;
            for (size_t i = 0; i < times.size(); ++i) {
                errors.add(curves[p][i],
                           spaced ? reference::curve(t, pixels[p].y, 0, times[i]) : exact[p][i]);
            }
        }
        samples.push_back(judged(spaced ? "ecir: kernel, keypoints spread" : "ecir: kernel", errors,
                                 bound, constant));
    }
    return samples;
}

/// Frames' largest change, over many draws, for derivatives that are each off by e or -e: over e.
double measured_growth(Device& device, const std::vector<float>& t, bool spaced) {
    sim::Random random(t.size(), 92);
    std::vector<Knots> pixels;
    for (int p = 0; p < 256; ++p) {
        Knots knots{t, {}};
        for (size_t i = 0; i < t.size(); ++i) {
            knots.y.push_back(random.bits() & 1 ? 1.0F : -1.0F);
        }
        pixels.push_back(std::move(knots));
    }
    double largest = 0;
    for (const auto& curve : kernel_curves(device, pixels, times_of(), spaced)) {
        for (const float value : curve) {
            largest = std::max(largest, std::abs(double{value}));
        }
    }
    return largest;
}

std::vector<Sample> growth(const Lab& lab, uint32_t n, double gap) {
    const auto t = paired_keypoints(n, std::min(gap, even_gap(n)));
    const double even = curve_amplification(paired_keypoints(n, even_gap(n)));
    std::vector<Sample> samples = {
        {.series = "64 x that of even keypoints", .value = 64 * even, .reference = true}};
    for (const bool spaced : {false, true}) {
        const std::string which = spaced ? "spread (paper)" : "as they lie (release)";
        samples.push_back(
            {.series = "theory, " + which,
             .value = curve_amplification(spaced ? reference::spread_keypoints(t) : t),
             .reference = true});
        Sample sample{.series = "ecir, " + which, .value = measured_growth(*lab.device, t, spaced)};
        sample.finite = std::isfinite(sample.value);
        if (!(sample.value <= 64 * even)) {
            sample.failed = true;
            char text[96];
            std::snprintf(text, sizeof text, "errors of dL/dt grow %.2g-fold, evenly spaced %.2g",
                          sample.value, even);
            sample.how = text;
        }
        samples.push_back(sample);
    }
    return samples;
}

Sweep over_spacing(const std::string& name, const std::string& title) {
    Sweep sweep{
        .name = name,
        .title = title + ", n = 10",
        .x = {"distance of neighbouring keypoints, us of 120 ms", cli::svg::Spread::logarithmic}};
    sweep.values = {1, 3, 10, 30, 100, 300, 1e3, 3e3, 1e4, 13333};
    sweep.quick = {1, 13333};
    return sweep;
}

Sweep over_count(const std::string& name, const std::string& title, const std::string& where) {
    Sweep sweep{.name = name,
                .title = title + ", " + where,
                .x = {"keypoints n", cli::svg::Spread::listed}};
    sweep.values = {2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 18, 20};
    sweep.quick = {2, 10, 20};
    return sweep;
}

Sweep errors_in(Sweep sweep, bool curve) {
    sweep.y = {"largest error, grey levels", cli::svg::Spread::logarithmic};
    sweep.limit = 1;
    sweep.fails = "error over one grey level and over n eps Lebesgue max|dL/dt|, what a stable "
                  "computation in float32 keeps; |dL/dt| <= 4";
    sweep.safe = curve ? "P at fixed Chebyshev nodes as products of rounded differences, then a "
                         "matrix made in double: under the bound everywhere"
                       : "each basis value is one product of rounded differences: under the bound "
                         "everywhere";
    sweep.promises = {{"ecir", 0, 1e9}};
    return sweep;
}

Sweep growth_in(Sweep sweep) {
    sweep.y = {"error of the frames over error of dL/dt", cli::svg::Spread::logarithmic};
    sweep.fails = "errors grow over 64 times more than with even keypoints";
    sweep.safe =
        "`paper` spreads keypoints to a sixteenth of their even distance; `release` leaves "
        "them, as its weights expect";
    sweep.promises = {{"ecir, spread", 0, 1e9}};
    return sweep;
}

} // namespace

std::vector<Sweep> curve_sweeps() {
    std::vector<Sweep> sweeps;
    const std::string p = "Rounding in dL/dt";
    const std::string l = "Rounding in the curve";
    const std::string g = "Noise of the derivatives in the frames";
    const auto by_gap = [](auto measure) {
        return [measure](const Lab& lab, double gap_us) {
            return measure(lab, kShipped, gap_us * kMicrosecond);
        };
    };
    const auto by_count = [](auto measure, double gap) {
        return [measure, gap](const Lab& lab, double n) {
            return measure(lab, static_cast<uint32_t>(n), gap);
        };
    };
    const auto slope = [](const Lab&, uint32_t n, double gap) { return derivative_errors(n, gap); };

    sweeps.push_back(errors_in(over_spacing("curve-derivative-spacing", p), false));
    sweeps.back().measure = by_gap(slope);
    sweeps.push_back(errors_in(over_spacing("curve-integral-spacing", l), true));
    sweeps.back().measure = by_gap(curve_errors);
    sweeps.push_back(
        errors_in(over_count("curve-derivative-n", p, "keypoints evenly spaced"), false));
    sweeps.back().measure = by_count(slope, 2);
    sweeps.push_back(errors_in(over_count("curve-integral-n", l, "keypoints evenly spaced"), true));
    sweeps.back().measure = by_count(curve_errors, 2);
    sweeps.push_back(
        errors_in(over_count("curve-integral-n-close", l, "neighbours 1 us apart"), true));
    sweeps.back().measure = by_count(curve_errors, kMicrosecond);
    sweeps.push_back(growth_in(over_spacing("curve-noise-spacing", g)));
    sweeps.back().measure = by_gap(growth);
    sweeps.push_back(growth_in(over_count("curve-noise-n", g, "neighbours 1 us apart")));
    sweeps.back().measure = by_count(growth, kMicrosecond);
    return sweeps;
}

} // namespace ecir::stability
