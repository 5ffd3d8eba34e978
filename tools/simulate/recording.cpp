#include "tools/simulate/recording.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace ecir::sim {
namespace {

/// Moments closer than this are one: far below the events' microsecond, far above rounding.
constexpr double same_us = 1e-3;

} // namespace

std::vector<double> truth_times(const Window& window, int frames) {
    const auto start = static_cast<double>(window.start_us);
    const auto end = static_cast<double>(window.end_us);
    if (frames == 1) {
        return {(start + end) / 2};
    }
    std::vector<double> times;
    times.reserve(static_cast<size_t>(frames));
    for (int i = 0; i < frames; ++i) {
        times.push_back(start + (end - start) * i / (frames - 1));
    }
    return times;
}

Shot expose(Scene& scene, EventCamera& camera, const Window& window, int frames) {
    if (window.end_us <= window.start_us || frames < 1) {
        throw std::invalid_argument("expose: empty window or no frames");
    }
    const auto start = static_cast<double>(window.start_us);
    const auto end = static_cast<double>(window.end_us);
    const std::vector<double> wanted = truth_times(window, frames);
    std::vector<double> knots = scene.knots(start, end);
    knots.insert(knots.end(), wanted.begin(), wanted.end());
    std::sort(knots.begin(), knots.end());
    const auto same = [](double a, double b) { return b - a < same_us; };
    knots.erase(std::unique(knots.begin(), knots.end(), same), knots.end());
    knots.back() = end;

    Shot shot;
    std::vector<double> sum;
    io::Image before;
    for (size_t k = 0; k < knots.size(); ++k) {
        io::Image frame = scene.at(knots[k]);
        camera.see(io::luminance(frame), knots[k]);
        sum.resize(frame.pixels.size());
        if (k > 0) {
            const double share = (knots[k] - knots[k - 1]) / (end - start) / 2;
            for (size_t i = 0; i < sum.size(); ++i) {
                sum[i] += share * (static_cast<double>(before.pixels[i]) +
                                   static_cast<double>(frame.pixels[i]));
            }
        }
        while (shot.truth.size() < wanted.size() &&
               wanted[shot.truth.size()] < knots[k] + same_us) {
            shot.truth.push_back(frame);
        }
        before = std::move(frame);
    }
    shot.blurry = std::move(before);
    std::transform(sum.begin(), sum.end(), shot.blurry.pixels.begin(),
                   [](double value) { return static_cast<float>(value); });
    return shot;
}

} // namespace ecir::sim
