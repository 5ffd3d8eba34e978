#include "layers/reference/edi.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>

#include "layers/edi_moments.hpp"

namespace ecir::reference {
namespace {

constexpr double small = 0.01;

/// E after the first, second, ... events of a pixel, 0 in front.
std::vector<double> steps(const PackedEvents& events, size_t pixel,
                          const EdiThresholds& thresholds) {
    std::vector<double> result{0};
    double positive = 0;
    double negative = 0;
    for (uint32_t i = events.offset[pixel]; i < events.offset[pixel + 1]; ++i) {
        (events.mark[i] >> 31 != 0 ? positive : negative) += 1;
        result.push_back(double{thresholds.positive} * positive -
                         double{thresholds.negative} * negative);
    }
    return result;
}

/// Frames of one size, [count][height][width].
struct Frames {
    size_t count, height, width;
    std::vector<double> values;
    [[nodiscard]] double& at(size_t k, size_t y, size_t x) {
        return values[(k * height + y) * width + x];
    }
    [[nodiscard]] double at(size_t k, size_t y, size_t x) const {
        return values[(k * height + y) * width + x];
    }
    /// In the middle of a window: of both of its ends' frames.
    [[nodiscard]] std::array<double, 2> middle_gradient(size_t window, size_t y, size_t x) const {
        const auto early = gradient(2 * window, y, x);
        const auto late = gradient(2 * window + 1, y, x);
        return {(early[0] + late[0]) / 2, (early[1] + late[1]) / 2};
    }
    /// Five-point derivatives along x and y.
    [[nodiscard]] std::array<double, 2> gradient(size_t k, size_t y, size_t x) const {
        return {
            (8 * (at(k, y, x + 1) - at(k, y, x - 1)) - (at(k, y, x + 2) - at(k, y, x - 2))) / 12,
            (8 * (at(k, y + 1, x) - at(k, y - 1, x)) - (at(k, y + 2, x) - at(k, y - 2, x))) / 12};
    }
};

/// Gaussian of standard deviation 1.5 pixels, cut at 4, along one axis; border pixels repeat.
Frames smooth(const Frames& from, bool vertical) {
    std::array<double, 9> weights{};
    for (int k = -4; k <= 4; ++k) {
        weights[static_cast<size_t>(k + 4)] = std::exp(-k * k / 4.5);
    }
    const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
    const auto shifted = [](size_t at, size_t tap, size_t size) {
        return static_cast<size_t>(std::clamp(static_cast<int64_t>(at + tap) - 4, int64_t{0},
                                              static_cast<int64_t>(size) - 1));
    };
    Frames to = from;
    for (size_t k = 0; k < from.count; ++k) {
        for (size_t y = 0; y < from.height; ++y) {
            for (size_t x = 0; x < from.width; ++x) {
                double sum = 0;
                for (size_t tap = 0; tap < weights.size(); ++tap) {
                    sum += weights[tap] * (vertical ? from.at(k, shifted(y, tap, from.height), x)
                                                    : from.at(k, y, shifted(x, tap, from.width)));
                }
                to.at(k, y, x) = sum / total;
            }
        }
    }
    return to;
}

/// The moments of the tile of one window whose first sample is (top, left).
std::array<double, edi_moment_count> tile_moments(const Frames& x, size_t window, size_t top,
                                                  size_t left, double ridge) {
    struct Sample {
        std::array<double, 2> g, b, s;
        double d;
    };
    std::vector<Sample> samples;
    constexpr size_t side = size_t{edi_tile_samples} * edi_sample_step;
    for (size_t row = top; row < std::min(top + side, x.height - 2); row += edi_sample_step) {
        for (size_t column = left; column < std::min(left + side, x.width - 2);
             column += edi_sample_step) {
            const auto first = x.middle_gradient(0, row, column);
            const auto last = x.middle_gradient(edi_windows - 1, row, column);
            samples.push_back({x.middle_gradient(window, row, column),
                               x.gradient(x.count - 1, row, column),
                               {last[0] - first[0], last[1] - first[1]},
                               x.at(2 * window + 1, row, column) - x.at(2 * window, row, column)});
        }
    }
    double xx = ridge, xy = 0, yy = ridge, xd = 0, yd = 0, dd = 0;
    for (const Sample& s : samples) {
        xx += s.g[0] * s.g[0];
        xy += s.g[0] * s.g[1];
        yy += s.g[1] * s.g[1];
        xd += s.g[0] * s.d;
        yd += s.g[1] * s.d;
        dd += s.d * s.d;
    }
    const double u = -(yy * xd - xy * yd) / (xx * yy - xy * xy);
    const double v = -(xx * yd - xy * xd) / (xx * yy - xy * xy);
    const double explained = dd > 0 ? std::clamp(-(u * xd + v * yd) / dd, 0.0, 1.0) : 0;
    std::array<double, edi_moment_count> moments{};
    for (const Sample& s : samples) {
        const double rest = s.d + u * s.g[0] + v * s.g[1];
        const double still = u * s.b[0] + v * s.b[1];
        moments[0] += still * rest;
        moments[1] += still * still;
        moments[2] += rest;
        moments[3] += std::abs(s.d);
        const double whole = u * s.s[0] + v * s.s[1];
        moments[4] += whole * rest;
        moments[5] += whole * whole;
        moments[6] += whole * still;
    }
    for (double& moment : moments) {
        moment *= explained;
    }
    return moments;
}

} // namespace

std::vector<double> edi_logarithm(std::span<const float> blurry, const PackedEvents& events,
                                  std::span<const double> times, const EdiThresholds& thresholds) {
    const size_t pixels = events.offset.size() - 1;
    std::vector<double> result(times.size() * pixels);
    for (size_t p = 0; p < pixels; ++p) {
        const auto begin = events.time.begin() + events.offset[p];
        const auto end = events.time.begin() + events.offset[p + 1];
        const auto level = steps(events, p, thresholds); // level[i] holds between event i - 1 and i
        std::vector<double> edges{-1};
        edges.insert(edges.end(), begin, end);
        edges.push_back(1);
        double peak = -INFINITY;
        for (size_t i = 0; i < level.size(); ++i) {
            peak = edges[i + 1] > edges[i] ? std::max(peak, level[i]) : peak;
        }
        double integral = 0;
        for (size_t i = 0; i < level.size(); ++i) {
            // A piece of no length may lie far above the peak.
            integral +=
                edges[i + 1] > edges[i] ? std::exp(level[i] - peak) * (edges[i + 1] - edges[i]) : 0;
        }
        for (size_t k = 0; k < times.size(); ++k) {
            const auto past = std::upper_bound(begin, end, static_cast<float>(times[k]));
            result[k * pixels + p] = std::log(double{blurry[p]} + small) +
                                     level[static_cast<size_t>(past - begin)] - peak -
                                     std::log(integral / 2);
        }
    }
    return result;
}

std::vector<double> edi(std::span<const float> blurry, const PackedEvents& events,
                        std::span<const double> times, const EdiThresholds& thresholds) {
    auto frames = edi_logarithm(blurry, events, times, thresholds);
    for (double& value : frames) {
        value = std::exp(std::min(value, 80.0)) - small;
    }
    return frames;
}

std::vector<double> edi_moments(std::span<const float> blurry, const PackedEvents& events,
                                uint32_t width, uint32_t height, const EdiThresholds& thresholds) {
    const EdiMomentShape shape = edi_moment_shape(width, height);
    const uint32_t most = edi_busy_events / (shape.bin * shape.bin);
    std::vector<double> times;
    for (uint32_t window = 0; window < edi_windows; ++window) {
        times.push_back(edi_window_start(window));
        times.push_back(edi_window_start(window) + edi_window_length);
    }
    const auto logarithm = edi_logarithm(blurry, events, times, thresholds);
    const size_t pixels = size_t{width} * height;
    Frames frames{times.size() + 1, shape.height, shape.width, {}};
    frames.values.resize(frames.count * frames.height * frames.width);
    for (size_t k = 0; k < frames.count; ++k) {
        for (size_t y = 0; y < size_t{shape.height} * shape.bin; ++y) {
            for (size_t x = 0; x < size_t{shape.width} * shape.bin; ++x) {
                const size_t p = y * width + x;
                const bool still = events.offset[p + 1] - events.offset[p] > most;
                const double value = k + 1 < frames.count && !still
                                         ? logarithm[k * pixels + p]
                                         : std::log(double{blurry[p]} + small);
                frames.at(k, y / shape.bin, x / shape.bin) += value / (shape.bin * shape.bin);
            }
        }
    }
    frames = smooth(smooth(frames, false), true);

    const double ridge =
        edi_motion_ridge * double{thresholds.positive} * double{thresholds.negative};
    const size_t plane = size_t{edi_windows} * shape.tiles();
    std::vector<double> result(edi_moment_count * plane);
    for (uint32_t window = 0; window < edi_windows; ++window) {
        for (uint32_t tile = 0; tile < shape.tiles(); ++tile) {
            constexpr size_t side = size_t{edi_tile_samples} * edi_sample_step;
            const auto moments = tile_moments(frames, window, 2 + tile / shape.tile_columns * side,
                                              2 + tile % shape.tile_columns * side, ridge);
            for (size_t m = 0; m < edi_moment_count; ++m) {
                result[m * plane + size_t{window} * shape.tiles() + tile] = moments[m];
            }
        }
    }
    return result;
}

} // namespace ecir::reference
