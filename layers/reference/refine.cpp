#include "layers/reference/refine.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "layers/elementwise.hpp"

namespace ecir {
namespace {

struct Case {
    uint32_t width, height;
    uint32_t d;
};

/// The last one: as in the network.
constexpr std::array<Case, 9> cases = {{
    {1, 1, 1},
    {1, 1, 3},
    {17, 5, 1},
    {17, 5, 2},
    {1, 19, 4},
    {65, 3, 14},
    {88, 2, 3},
    {33, 11, 5},
    {240, 180, 14},
}};

std::string size_text(uint32_t width, uint32_t height) {
    return std::to_string(width) + "x" + std::to_string(height);
}

} // namespace

std::vector<double> reference::refine_state(std::span<const float> frames,
                                            std::span<const float> counts, const ImageSize& size) {
    const size_t pixels = size.pixels();
    const size_t d = frames.size() / pixels;
    std::vector<double> state;
    for (size_t i = 0; i < d; ++i) {
        const auto values = frames.subspan(i * pixels, pixels);
        state.insert(state.end(), values.begin(), values.end());
        for (size_t p = 0; p < pixels; ++p) {
            state.push_back(p % size.width == 0 ? 0 : double{values[p - 1]} - values[p]);
        }
        for (size_t p = 0; p < pixels; ++p) {
            state.push_back(p < size.width ? 0 : double{values[p - size.width]} - values[p]);
        }
        if (i + 1 < d) {
            const auto events = counts.subspan(2 * i * pixels, 2 * pixels);
            state.insert(state.end(), events.begin(), events.end());
        }
        state.resize((i + 1) * refine_planes * pixels);
    }
    return state;
}

std::vector<float> reference::update_state(std::span<const float> frames,
                                           std::span<const float> residuals,
                                           const ImageSize& size) {
    const size_t pixels = size.pixels();
    const size_t d = frames.size() / pixels;
    std::vector<float> state(refine_planes * frames.size());
    const auto place = [&](std::span<const float> from, size_t i, size_t plane) {
        std::ranges::copy(from.subspan(i * pixels, pixels),
                          state.begin() + static_cast<std::ptrdiff_t>(plane * pixels));
    };
    for (size_t i = 0; i < d; ++i) {
        place(frames, i, refine_planes * i);
        if (i + 1 < d) {
            place(residuals, i, refine_planes * (i + 1) + refine_residual_plane);
        }
    }
    return state;
}

std::vector<double> reference::refine_update(std::span<const float> initial,
                                             std::span<const float> frames,
                                             std::span<const float> residuals,
                                             const AlphaWeights& alpha, const ImageSize& size,
                                             float largest_step) {
    const size_t pixels = size.pixels();
    const size_t d = frames.size() / pixels;
    std::vector<double> updated(frames.size());
    for (size_t i = 0; i < d; ++i) {
        for (uint32_t y = 0; y < size.height; ++y) {
            for (uint32_t x = 0; x < size.width; ++x) {
                double sum = alpha[9];
                for (uint32_t v = std::max(y, 1U) - 1; v <= std::min(y + 1, size.height - 1); ++v) {
                    for (uint32_t u = std::max(x, 1U) - 1; u <= std::min(x + 1, size.width - 1);
                         ++u) {
                        sum += double{alpha[3 * (v + 1 - y) + (u + 1 - x)]} *
                               frames[i * pixels + size_t{v} * size.width + u];
                    }
                }
                const size_t at = i * pixels + size_t{y} * size.width + x;
                const double value = frames[at];
                double direction = 2 * (value - initial[at]);
                if (i > 0) {
                    direction -= 2 * (double{frames[at - pixels]} + residuals[at - pixels] - value);
                }
                if (i + 1 < d) {
                    direction += 2 * (value + residuals[at] - frames[at + pixels]);
                }
                updated[at] =
                    value - std::min(0.1 * std::max(sum, 0.0), double{largest_step}) * direction;
            }
        }
    }
    return updated;
}

Trial refine_state_trial(Device& device, uint32_t trial) {
    const Case& shape = cases.at(trial);
    const reference::ImageSize size{shape.height, shape.width};
    CaseRandom random(400 + trial);
    const uint32_t intervals = shape.d - 1;
    const auto frames = random.values(shape.d * size.pixels(), -0.5, 1.5);
    std::vector<float> counts(size_t{2} * intervals * size.pixels());
    for (float& count : counts) {
        count = static_cast<float>(random.integer(0, 9));
    }
    Trial result;
    result.shape = std::to_string(shape.d) + " frames " + size_text(shape.width, shape.height);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const uint32_t halo = trial % 2;
    const Tensor frame_input = program.input({shape.d, shape.height, shape.width, 1, halo});
    const Tensor doubled = program.temporary(frame_input.layout());
    record_add(program, frame_input, frame_input, doubled);
    const Tensor count_input =
        program.input({std::max(2 * intervals, 1U), shape.height, shape.width, 1, 1 - halo});
    result.output = program.output(refine_state_layout(shape.d, shape.height, shape.width));
    program.clear(result.output);
    // First with the counts of the case and twice its frames, then its frames and no counts.
    record_refine_state(program, doubled, &count_input, result.output);
    result.first_step = program.steps();
    record_refine_state(program, frame_input, nullptr, result.output);
    program.finish();
    program.write(frame_input, from_dense(frame_input.layout(), frames));
    if (intervals > 0) {
        program.write(count_input, from_dense(count_input.layout(), counts));
    }
    result.reference = reference::refine_state(frames, counts, size);
    return result;
}

namespace {

/// What to look at after an update.
enum class Looked { updated, largest };

Trial update_trial(Device& device, uint32_t trial, Looked looked) {
    const Case& shape = cases.at(trial);
    const reference::ImageSize size{shape.height, shape.width};
    CaseRandom random(500 + trial);
    const auto initial = random.values(shape.d * size.pixels(), 0, 1);
    const auto frames = random.values(shape.d * size.pixels(), 0, 1);
    const auto residuals = random.values((shape.d - 1) * size.pixels(), -1, 1);
    AlphaWeights alpha{};
    for (float& weight : alpha) {
        weight = static_cast<float>(random.uniform(-0.5, 0.5));
    }
    alpha[9] = 0.25F; // both signs of alpha before its ReLU
    // Bounded by turns, so that many steps are over the bound.
    const float largest = trial % 2 == 0 ? 0.02F : std::numeric_limits<float>::infinity();

    Trial result;
    result.shape = std::to_string(shape.d) + " frames " + size_text(shape.width, shape.height);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout layout{shape.d, shape.height, shape.width, 1, 1};
    const Tensor initial_input = program.input(layout);
    const Tensor state = program.input(refine_state_layout(shape.d, shape.height, shape.width));
    const Tensor updated = program.output(layout);
    const Tensor change = program.output({1, 1, 1});
    result.output = looked == Looked::updated ? updated : change;
    program.clear(updated);
    program.clear(change);
    result.first_step = program.steps();
    record_refine_update(program, initial_input, state, alpha, updated, change, largest);
    program.finish();
    program.write(initial_input, from_dense(layout, initial));
    program.write(state,
                  from_dense(state.layout(), reference::update_state(frames, residuals, size)));
    result.reference = reference::refine_update(initial, frames, residuals, alpha, size, largest);
    if (looked == Looked::largest) {
        double most = 0;
        for (size_t i = 0; i < frames.size(); ++i) {
            most = std::max(most, std::abs(result.reference[i] - frames[i]));
        }
        result.reference = {most};
    }
    return result;
}

} // namespace

Trial refine_update_trial(Device& device, uint32_t trial) {
    return update_trial(device, trial, Looked::updated);
}

Trial refine_largest_trial(Device& device, uint32_t trial) {
    return update_trial(device, trial, Looked::largest);
}

} // namespace ecir
