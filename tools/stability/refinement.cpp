#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "layers/reference/refine.hpp"
#include "layers/refine.hpp"
#include "tools/simulate/random.hpp"
#include "tools/stability/frames.hpp"
#include "tools/stability/weights_copy.hpp"

// The refinement's descent on equation 8.
//
// With residuals R and the initialisation L0 held, the objective of a pixel over its d frames is
//     f(L) = sum_i (L_i + R_i - L_{i+1})^2 + lambda sum_i (L_i - L0_i)^2,
// a quadratic with Hessian H = 2 (lambda I + D^T D), D the difference of neighbours, so D^T D is
// the Laplacian of a path, whose largest eigenvalue is 2 + 2 cos(pi / d). For a step A grad f, A
// diagonal with any 0 <= A_ii <= a,
//     f(L - A g) = f(L) - g^T (A - A H A / 2) g,
// and A - A H A / 2 = A^(1/2) (I - A^(1/2) H A^(1/2) / 2) A^(1/2) >= 0 where a |H| <= 2. So the
// objective never grows, whatever steps a network gives to each pixel of each frame, if
//     a <= 2 / |H| = 1 / (lambda + 2 + 2 cos(pi / d)),
// layers/refine.hpp's largest_refine_step() with lambda = 1; 1/5 does for any number of frames.

namespace ecir::stability {
namespace {

constexpr double kWorse = 0.5; ///< dB below the curve

/// f for one pixel, with R the differences of L0, so that its least value is 0, at L0.
double objective(const std::vector<double>& moved) {
    double sum = 0;
    for (size_t i = 0; i < moved.size(); ++i) {
        sum += moved[i] * moved[i];
        if (i + 1 < moved.size()) {
            sum += (moved[i] - moved[i + 1]) * (moved[i] - moved[i + 1]);
        }
    }
    return sum;
}

/// The eigenvector of the path's Laplacian with the largest eigenvalue.
std::vector<double> stiffest(uint32_t d) {
    std::vector<double> vector;
    for (uint32_t i = 0; i < d; ++i) {
        vector.push_back((i % 2 == 0 ? 1 : -1) * std::sin((i + 0.5) * std::numbers::pi / d));
    }
    return vector;
}

/// Largest f after one step over f before it, among many starts: by the reference of the kernel
/// with one step for all frames, or with steps drawn for each from 0 to `step`.
double growth(uint32_t d, double step, bool drawn) {
    sim::Random random(d, drawn ? 94 : 93);
    double worst = 0;
    const reference::ImageSize pixel{1, 1};
    for (int start = 0; start < 200; ++start) {
        std::vector<double> moved = stiffest(d);
        for (double& value : moved) {
            value = start == 0 ? value : random.uniform(-1, 1);
        }
        // L0 = 0, R = 0: any other pair of which R is the differences shifts both by L0.
        const std::vector<float> zero(d);
        const std::vector<float> frames(moved.begin(), moved.end());
        AlphaWeights alpha{};
        alpha.back() = static_cast<float>(10 * step); // alpha = 0.1 ReLU(bias)
        std::vector<double> next =
            reference::refine_update(zero, frames, std::span(zero).first(d - 1), alpha, pixel);
        for (size_t i = 0; drawn && i < d; ++i) {
            next[i] = moved[i] + random.uniform() * (next[i] - moved[i]);
        }
        worst = std::max(worst, objective(next) / objective(moved));
    }
    return worst;
}

std::vector<Sample> descent(const Lab&, double step) {
    std::vector<Sample> samples;
    for (const auto& [d, drawn] : {std::pair{2U, false}, {14U, false}, {14U, true}}) {
        Sample sample{.series = std::to_string(d) + " frames, " +
                                (drawn ? "steps from 0 to it" : "one step"),
                      .value = growth(d, step, drawn)};
        sample.finite = std::isfinite(sample.value);
        if (!(sample.value <= 1 + 1e-6)) {
            sample.failed = true;
            char text[64];
            std::snprintf(text, sizeof text, "the objective grows %.3g-fold a step", sample.value);
            sample.how = text;
        }
        samples.push_back(sample);
    }
    const double stiff = 2 * (3 + 2 * std::cos(std::numbers::pi / 14));
    samples.push_back({.series = "theory: (1 - step |H|)^2, 14",
                       .value = std::pow(1 - step * stiff, 2),
                       .reference = true});
    return samples;
}

/// The E-CIR models among the methods, by the name of their file.
std::vector<const Method*> ecir_methods(const Lab& lab) {
    std::vector<const Method*> found;
    for (const Method& method : lab.methods) {
        if (method.name.ends_with(", refined")) {
            found.push_back(&method);
        }
    }
    return found;
}

/// A model's PSNR with `method`, judged against that of its curve.
Sample refined(const Lab& lab, const Method& method, const std::string& name, double curve) {
    Sample sample{.series = name};
    for (const Subject& subject : lab.subjects) {
        const Capture seen = capture(subject, nominal(subject));
        const auto frames = find_frames(lab, method, seen).frames;
        sample.finite =
            sample.finite && std::ranges::all_of(frames, [](float v) { return std::isfinite(v); });
        sample.value += psnr(frames, seen) / static_cast<double>(lab.subjects.size());
    }
    if (!sample.finite) {
        sample.value = std::nan("");
        sample.failed = true;
        sample.how = "a value that is not finite";
    } else if (sample.value < curve - kWorse) {
        sample.failed = true;
        char text[64];
        std::snprintf(text, sizeof text, "%.1f dB below the curve", curve - sample.value);
        sample.how = text;
    }
    return sample;
}

Sample curve_of(const Lab& lab, const Method& method) {
    Method curve = method;
    curve.options.refine = 0;
    Sample sample = refined(lab, curve, method.options.model + ", curve", -1e9);
    sample.reference = true;
    return sample;
}

/// The curve's own, and what the refined frames must not fall below.
void add_references(std::vector<Sample>& samples, const Sample& curve) {
    samples.push_back(curve);
    samples.push_back({.series = "fails below", .value = curve.value - kWorse, .reference = true});
}

std::vector<Sample> iterations(const Lab& lab, double count) {
    std::vector<Sample> samples;
    for (const Method* method : ecir_methods(lab)) {
        const Sample curve = curve_of(lab, *method);
        add_references(samples, curve);
        Method with = *method;
        with.options.refine = static_cast<uint32_t>(count);
        samples.push_back(refined(lab, with, with.options.model + ", refined", curve.value));
    }
    return samples;
}

std::vector<Sample> scaled_steps(const Lab& lab, double factor) {
    std::vector<Sample> samples;
    for (const Method* method : ecir_methods(lab)) {
        const Sample curve = curve_of(lab, *method);
        add_references(samples, curve);
        // ReLU passes a factor on, so this scales alpha itself.
        const WeightsCopy weights(SafeTensors(find_model(method->options.model)),
                                  [&](const std::string& name, float value) {
                                      return name.starts_with("refine.alpha_net.")
                                                 ? static_cast<float>(factor * value)
                                                 : value;
                                  });
        for (const uint32_t count : {1U, 3U, 20U}) {
            Method with = *method;
            with.options.model = weights.path().string();
            with.options.refine = count;
            samples.push_back(refined(lab, with,
                                      method->options.model + ", " + std::to_string(count) +
                                          (count == 1 ? " iteration" : " iterations"),
                                      curve.value));
        }
    }
    return samples;
}

} // namespace

std::vector<Sweep> refinement_sweeps() {
    std::vector<Sweep> sweeps;

    Sweep step{.name = "refine-descent",
               .title = "One gradient step on equation 8: the objective after over before",
               .x = {"step alpha", cli::svg::Spread::logarithmic},
               .y = {"largest growth of the objective", cli::svg::Spread::logarithmic}};
    step.values = {0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.21, 0.25, 0.3, 0.4, 0.5, 0.7, 1};
    step.quick = {0.1, 0.2, 0.4};
    step.limit = 1;
    step.fails = "an update that grows the objective";
    step.safe = "the objective's Hessian gives the largest step, 1 / (3 + 2 cos(pi / d)) > 1/5, "
                "below which no step of any pixel or frame lets it grow";
    step.promises = {{"", 0, 0.2}};
    step.measure = descent;
    sweeps.push_back(step);

    Sweep count{.name = "refine-iterations",
                .title = "Iterations of the refinement (trained: 3)",
                .x = {"iterations", cli::svg::Spread::listed},
                .y = {"PSNR, dB"}};
    count.values = {0, 1, 2, 3, 4, 6, 8, 12, 16, 20};
    count.quick = {0, 3, 20};
    count.fails = "PSNR over 0.5 dB below the curve's, or a value that is not finite";
    count.safe = "as many as trained by default, and more end where changes no longer fall; "
                 "--refine 0 is the curve";
    count.promises = {{"", 0, 20}};
    count.measure = iterations;
    sweeps.push_back(count);

    Sweep scale{.name = "refine-step-scale",
                .title = "The network's steps scaled",
                .x = {"factor of alpha", cli::svg::Spread::logarithmic},
                .y = {"PSNR, dB"}};
    scale.values = {0.1, 0.2, 0.5, 0.7, 1, 1.4, 2, 3, 5, 10};
    scale.quick = {0.1, 1, 10};
    scale.fails = "PSNR over 0.5 dB below the curve's, or a value that is not finite";
    scale.safe = "no step exceeds the bound of refine-descent, so frames stay finite with any "
                 "weights; residuals made anew in each iteration could still lead many of them "
                 "astray, so beyond the trained ones they end where changes no longer fall";
    scale.promises = {{"", 0.1, 10}};
    scale.measure = scaled_steps;
    sweeps.push_back(scale);
    return sweeps;
}

} // namespace ecir::stability
