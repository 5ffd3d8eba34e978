#include "layers/reference/consistency.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string>

#include "layers/deblur.hpp"
#include "layers/elementwise.hpp"

namespace ecir::reference {
namespace {

/// [1 6 1] / 8 along one axis; beyond the border its values repeat.
std::vector<double> smooth(const std::vector<double>& from, int width, bool vertical) {
    constexpr int kReach = 1;
    constexpr std::array kWeights = {6, 1}; // of the middle and beside it
    const int height = static_cast<int>(from.size()) / width;
    std::vector<double> to(from.size());
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            double sum = 0;
            for (int k = -kReach; k <= kReach; ++k) {
                const int row = std::clamp(y + (vertical ? k : 0), 0, height - 1);
                const int column = std::clamp(x + (vertical ? 0 : k), 0, width - 1);
                sum += kWeights.at(static_cast<size_t>(std::abs(k))) / 8.0 *
                       from[static_cast<size_t>(row) * static_cast<size_t>(width) +
                            static_cast<size_t>(column)];
            }
            to[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)] = sum;
        }
    }
    return to;
}

} // namespace

std::vector<double> consistent(std::span<const float> frames, std::span<const float> prior,
                               std::span<const float> blurry, std::span<const float> shares,
                               uint32_t width) {
    const size_t pixels = blurry.size();
    std::vector<double> change(pixels);
    for (size_t p = 0; p < pixels; ++p) {
        float most = blurry[p];
        for (size_t i = 0; i < shares.size(); ++i) {
            const float value = frames[i * pixels + p];
            most = std::max(most, value);
            change[p] -= double{shares[i]} * (double{value} - prior[i * pixels + p]);
        }
        change[p] = most < consistency_limit ? change[p] : 0;
    }
    change = smooth(smooth(change, static_cast<int>(width), false), static_cast<int>(width), true);
    std::vector<double> result(frames.begin(), frames.end());
    for (size_t i = 0; i < result.size(); ++i) {
        result[i] += change[i % pixels];
    }
    return result;
}

} // namespace ecir::reference

namespace ecir {
namespace {

struct Case {
    uint32_t frames, height, width;
    uint32_t halo; ///< of the prior
    double brightest;
};

/// The last one: as in the network.
constexpr std::array<Case, 6> cases = {{
    {5, 7, 9, 0, 0.9},
    {14, 3, 65, 1, 1.1}, // some pixels saturated
    {6, 1, 130, 3, 1.05},
    {1, 1, 1, 1, 0.9}, // does not cover the exposure
    {9, 17, 1, 2, 1.0},
    {14, 180, 240, 1, 1.0},
}};

} // namespace

Trial consistency_trial(Device& device, uint32_t trial) {
    const auto [count, height, width, halo, brightest] = cases.at(trial);
    CaseRandom random(1300 + trial);
    Trial result;
    result.shape = std::to_string(count) + " frames " + std::to_string(width) + "x" +
                   std::to_string(height) + " halo " + std::to_string(halo);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout priors{count, height, width, 1, halo};
    const Tensor start = program.input({count, height, width});
    const Tensor prior = program.input(priors);
    const Tensor blurry = program.input({1, height, width});
    const Tensor instants = program.input(instant_layout(count));
    result.output = program.output({count, height, width});
    const Tensor nothing = program.cleared({count, height, width});
    record_add(program, start, nothing, result.output);
    result.first_step = program.steps();
    const Tensor state = program.cleared(consistency_state_layout(height, width));
    for (uint32_t i = 0; i < count; ++i) {
        record_consistency(program, result.output.channels(i, 1), prior.channels(i, 1), blurry,
                           instants.channels(i, 1), state, i + 1 == count);
    }
    record_consistent(program, state, result.output);
    program.finish();

    const size_t pixels = size_t{height} * width;
    const auto frame_values = random.values(count * pixels, 0, brightest);
    const auto prior_values = random.values(count * pixels, 0, 1);
    const auto blurry_values = random.values(pixels, 0, brightest);
    const auto made = make_instants(even_times(count));
    std::vector<float> shares;
    shares.reserve(made.size());
    for (const Instant& instant : made) {
        shares.push_back(instant.share);
    }
    program.write(start, frame_values);
    program.write(prior, from_dense(priors, prior_values));
    program.write(blurry, blurry_values);
    program.write(instants, std::as_bytes(std::span(made)));
    result.reference =
        reference::consistent(frame_values, prior_values, blurry_values, shares, width);
    return result;
}

} // namespace ecir
