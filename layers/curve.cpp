#include "layers/curve.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Frames a dispatch writes: their rows of S are unrolled in the shader (FRAMES there).
constexpr uint32_t frames_per_dispatch = 16;

/// Mirrors the push constants of shaders/curve.comp.
struct Push {
    PushLayout derivatives;
    PushLayout keypoints;
    PushLayout blurry;
    PushLayout frames;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t derivative_channel = 0;
    uint32_t keypoint_channel = 0;
    uint32_t blurry_channel = 0;
    uint32_t row = 0;   ///< of S for the view's channel 0
    uint32_t count = 0; ///< frames to write
    float spacing = 0;
};
static_assert(sizeof(Push) == 96);

void check_count(uint32_t n) {
    if (n < min_keypoints || n > max_keypoints) {
        throw Error(ExitCode::bad_input, "a curve through " + std::to_string(n) + " keypoints: " +
                                             std::to_string(min_keypoints) + " to " +
                                             std::to_string(max_keypoints) + " are supported");
    }
}

void check_channels(const char* what, const Layout& layout, uint32_t first, uint32_t count,
                    const Layout& frames) {
    if (layout.height != frames.height || layout.width != frames.width ||
        first + count > layout.channels) {
        throw Error(ExitCode::bad_input,
                    "curve: channels " + std::to_string(first) + " to " +
                        std::to_string(first + count - 1) + " of the " + what + ", " +
                        std::to_string(layout.channels) + "x" + std::to_string(layout.height) +
                        "x" + std::to_string(layout.width) + ", do not give frames of " +
                        std::to_string(frames.height) + "x" + std::to_string(frames.width));
    }
}

/// Lagrange basis k of `nodes` at x.
double basis(const std::vector<float>& nodes, size_t k, double x) {
    double product = 1;
    for (size_t j = 0; j < nodes.size(); ++j) {
        if (j != k) {
            product *= (x - nodes[j]) / (double{nodes[k]} - nodes[j]);
        }
    }
    return product;
}

/// The Legendre polynomial of a degree at x, and the one of a degree less.
struct Legendre {
    double value = 1;
    double before = 0;
};

Legendre legendre(uint32_t degree, double x) {
    Legendre found;
    for (uint32_t k = 1; k <= degree; ++k) {
        const double next = ((2.0 * k - 1) * x * found.value - (k - 1.0) * found.before) / k;
        found = {next, found.value};
    }
    return found;
}

void check_time(double time) {
    if (!(time >= -1 && time <= 1)) {
        throw Error(ExitCode::bad_input,
                    "curve: time " + std::to_string(time) + " is outside the exposure, -1 to 1");
    }
}

} // namespace

Quadrature gauss_legendre(uint32_t count) {
    Quadrature rule{std::vector<double>(count), std::vector<double>(count)};
    for (uint32_t i = 0; i < count; ++i) {
        // Newton on the Legendre polynomial, from a close estimate of its root.
        double x = -std::cos(std::numbers::pi * (i + 0.75) / (count + 0.5));
        double slope = 1;
        for (int iteration = 0; iteration < 8; ++iteration) {
            const auto [value, before] = legendre(count, x);
            slope = count * (before - x * value) / (1 - x * x);
            x -= value / slope;
        }
        rule.nodes[i] = x;
        rule.weights[i] = 2 / ((1 - x * x) * slope * slope);
    }
    return rule;
}

std::vector<float> curve_nodes(uint32_t n) {
    check_count(n);
    std::vector<float> nodes(n);
    for (uint32_t k = 0; k < n; ++k) {
        nodes[k] = static_cast<float>(-std::cos((2.0 * k + 1) * std::numbers::pi / (2.0 * n)));
    }
    return nodes;
}

std::vector<float> curve_matrix(uint32_t n, std::span<const double> times) {
    const std::vector<float> nodes = curve_nodes(n);
    const Quadrature rule = gauss_legendre(n);
    std::vector<double> mean(n, 0.0); // half the integral of (1 - s) basis_k(s): of the primitive
    for (uint32_t k = 0; k < n; ++k) {
        for (uint32_t q = 0; q < n; ++q) {
            mean[k] += 0.5 * rule.weights[q] * (1 - rule.nodes[q]) * basis(nodes, k, rule.nodes[q]);
        }
    }
    std::vector<float> matrix(nodes);
    for (const double time : times) {
        check_time(time);
        const double half = (time + 1) / 2;
        for (uint32_t k = 0; k < n; ++k) {
            double primitive = 0;
            for (uint32_t q = 0; q < n; ++q) {
                primitive +=
                    half * rule.weights[q] * basis(nodes, k, half * (rule.nodes[q] + 1) - 1);
            }
            matrix.push_back(static_cast<float>(primitive - mean[k]));
        }
    }
    return matrix;
}

std::vector<float> curve_series(uint32_t n, std::span<const double> times) {
    const std::vector<float> nodes = curve_nodes(n);
    const Quadrature rule = gauss_legendre(n);
    std::vector<float> series(nodes);
    for (uint32_t j = 0; j < n; ++j) {
        for (uint32_t k = 0; k < n; ++k) {
            double share = 0;
            for (uint32_t q = 0; q < n; ++q) {
                const double x = rule.nodes[q];
                share += (j + 0.5) * rule.weights[q] * legendre(j, x).value * basis(nodes, k, x);
            }
            series.push_back(static_cast<float>(share));
        }
    }
    for (const double time : times) {
        check_time(time);
        for (uint32_t j = 0; j < n; ++j) {
            // (2 j + 1) P_j is the slope of P_{j+1} - P_{j-1}, which is 0 at -1; of these only P_0
            // has a mean.
            const double rise =
                j == 0 ? time : legendre(j + 1, time).value - legendre(j - 1, time).value;
            const double mean = j == 1 ? -1.0 : 0;
            series.push_back(static_cast<float>((rise - mean) / (2.0 * j + 1)));
        }
    }
    return series;
}

Layout curve_matrix_layout(uint32_t n, uint32_t d, bool ordered) {
    Layout layout;
    layout.width = n * (d + 1 + (ordered ? n : 0));
    return layout;
}

std::vector<size_t> curve_orders(std::span<const uint32_t> offsets, uint32_t width, uint32_t height,
                                 uint32_t n) {
    std::vector<size_t> pixels(size_t{n} + 1);
    for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x) {
            const size_t left = std::max(x, 1U) - 1;
            const size_t right = std::min(x + 1, width - 1);
            uint32_t events = 0;
            for (uint32_t row = std::max(y, 1U) - 1; row <= std::min(y + 1, height - 1); ++row) {
                const size_t begin = size_t{row} * width;
                events += offsets[begin + right + 1] - offsets[begin + left];
            }
            ++pixels[std::min(events, n)];
        }
    }
    return pixels;
}

float keypoint_spacing(uint32_t n) {
    return static_cast<float>(2.0 / (n - 1.0) / 16.0);
}

void record_curve(Program& program, const Tensor& derivatives, const Tensor& keypoints,
                  const Tensor& blurry, const Tensor& matrix, const Tensor& frames,
                  const CurveOptions& options) {
    const uint32_t n = options.n;
    const Layout& layout = frames.layout();
    check_count(n);
    check_channels("derivatives", derivatives.layout(), options.derivative_channel, n, layout);
    check_channels("keypoints", keypoints.layout(), options.keypoint_channel, n, layout);
    check_channels("blurry frame", blurry.layout(), options.blurry_channel, 1, layout);
    const bool ordered = options.offsets.has_value();
    if (layout.block != 1 ||
        matrix.layout().width != curve_matrix_layout(n, layout.channels, ordered).width) {
        throw Error(ExitCode::bad_input,
                    "curve: " + std::to_string(layout.channels) + " frames in blocks of " +
                        std::to_string(layout.block) + " do not match a matrix of " +
                        std::to_string(matrix.layout().width) + " values");
    }
    if (ordered && options.offsets->layout().width != layout.width * layout.height + 1) {
        throw Error(ExitCode::bad_input,
                    "curve: " + std::to_string(options.offsets->layout().width) +
                        " pixel offsets do not fit frames of " + std::to_string(layout.height) +
                        "x" + std::to_string(layout.width));
    }
    const std::array<uint32_t, 3> constants = {n, options.spaced ? 1U : 0U, ordered ? 1U : 0U};
    const Kernel& kernel = program.device().kernel("curve", constants, 6, sizeof(Push));
    for (const auto& group : channel_groups(program.device().info(), layout, 1)) {
        for (uint32_t done = 0; done < group.count; done += frames_per_dispatch) {
            const uint32_t first = group.first + done;
            const uint32_t count = std::min(frames_per_dispatch, group.count - done);
            const Tensor view = frames.channels(first, count);
            Dispatch dispatch;
            dispatch.kernel = &kernel;
            dispatch.arguments = {read(derivatives), read(keypoints),
                                  read(blurry),      read(matrix),
                                  write(view),       read(options.offsets.value_or(matrix))};
            dispatch.set_push(Push{PushLayout(derivatives), PushLayout(keypoints),
                                   PushLayout(blurry), PushLayout(view), layout.width,
                                   layout.height, options.derivative_channel,
                                   options.keypoint_channel, options.blurry_channel, first, count,
                                   keypoint_spacing(n)});
            dispatch.groups = pixel_groups(layout);
            const double pixels = static_cast<double>(layout.width) * layout.height;
            dispatch.flops = pixels * ((ordered ? 10.0 : 8.0) * n * n + 2.0 * n * count);
            dispatch.bytes = pixels * 4 * (2.0 * n + 1 + count);
            dispatch.label = "curve";
            program.add(std::move(dispatch));
        }
    }
}

} // namespace ecir
