#include "tools/ecir/metrics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace ecir::metrics {
namespace {

constexpr int window = 7;

/// Sums over a window of t, p, t^2, p^2, t p. Whole numbers, so exact in whatever order.
using Sums = std::array<int64_t, 5>;

void check(const Frame& truth, const Frame& prediction) {
    if (truth.width != prediction.width || truth.height != prediction.height ||
        truth.channels != prediction.channels || truth.values.size() != prediction.values.size()) {
        throw std::invalid_argument("metrics: the frames differ in shape");
    }
    if (truth.width < window || truth.height < window) {
        throw std::invalid_argument("metrics: a frame is smaller than 7 x 7");
    }
}

void add(Sums& sums, int64_t t, int64_t p, int64_t sign) {
    const Sums values{t, p, t * t, p * p, t * p};
    for (size_t k = 0; k < sums.size(); ++k) {
        sums[k] += sign * values[k];
    }
}

double similarity(const Sums& sums) {
    constexpr double count = window * window;
    constexpr double to_sample = count / (count - 1);
    constexpr double c1 = (0.01 * 255) * (0.01 * 255);
    constexpr double c2 = (0.03 * 255) * (0.03 * 255);
    std::array<double, 5> mean{};
    std::transform(sums.begin(), sums.end(), mean.begin(),
                   [](int64_t sum) { return static_cast<double>(sum) / count; });
    const auto [t, p, tt, pp, tp] = mean;
    const double variances = to_sample * (tt - t * t + pp - p * p);
    const double covariance = to_sample * (tp - t * p);
    return (2 * t * p + c1) * (2 * covariance + c2) / ((t * t + p * p + c1) * (variances + c2));
}

double ssim_of_channel(const Frame& truth, const Frame& prediction, size_t channel) {
    const auto width = static_cast<size_t>(truth.width);
    const auto height = static_cast<size_t>(truth.height);
    const auto channels = static_cast<size_t>(truth.channels);
    std::vector<Sums> columns(width, Sums{}); // over the last `window` rows
    double total = 0;
    for (size_t y = 0; y < height; ++y) {
        for (size_t x = 0; x < width; ++x) {
            const size_t i = (y * width + x) * channels + channel;
            add(columns[x], truth.values[i], prediction.values[i], 1);
            if (y >= window) {
                const size_t old = i - window * width * channels;
                add(columns[x], truth.values[old], prediction.values[old], -1);
            }
        }
        if (y + 1 < window) {
            continue;
        }
        Sums sums{};
        for (size_t x = 0; x < width; ++x) {
            for (size_t k = 0; k < sums.size(); ++k) {
                sums[k] += columns[x][k] - (x >= window ? columns[x - window][k] : 0);
            }
            if (x + 1 >= window) {
                total += similarity(sums);
            }
        }
    }
    return total / static_cast<double>((width - window + 1) * (height - window + 1));
}

} // namespace

std::vector<uint8_t> to_8_bit(std::span<const float> values) {
    std::vector<uint8_t> result(values.size());
    std::transform(values.begin(), values.end(), result.begin(), [](float value) {
        return static_cast<uint8_t>(std::clamp(value, 0.0F, 1.0F) * 255.0F);
    });
    return result;
}

double ssim(const Frame& truth, const Frame& prediction) {
    check(truth, prediction);
    double sum = 0;
    for (int c = 0; c < truth.channels; ++c) {
        sum += ssim_of_channel(truth, prediction, static_cast<size_t>(c));
    }
    return sum / truth.channels;
}

Figures compare(const Frame& truth, const Frame& prediction) {
    Figures figures;
    figures.ssim = ssim(truth, prediction);
    int64_t squares = 0;
    int64_t truth_squares = 0;
    for (size_t i = 0; i < truth.values.size(); ++i) {
        const int64_t t = truth.values[i];
        const int64_t difference = prediction.values[i] - t;
        squares += difference * difference;
        truth_squares += t * t;
    }
    constexpr double infinite = std::numeric_limits<double>::infinity();
    if (squares == 0) {
        figures.psnr = infinite;
        return figures;
    }
    const double mse = static_cast<double>(squares) / static_cast<double>(truth.values.size());
    figures.psnr = 10 * std::log10(255.0 * 255.0 / mse);
    figures.nrmse =
        truth_squares == 0
            ? infinite
            : std::sqrt(static_cast<double>(squares) / static_cast<double>(truth_squares));
    return figures;
}

Figures mean(std::span<const Figures> frames) {
    Figures sum;
    for (const Figures& frame : frames) {
        sum.nrmse += frame.nrmse;
        sum.psnr += frame.psnr;
        sum.ssim += frame.ssim;
    }
    const auto count = static_cast<double>(frames.size());
    return {sum.nrmse / count, sum.psnr / count, sum.ssim / count};
}

} // namespace ecir::metrics
