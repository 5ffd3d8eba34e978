#include "layers/reference/refine.hpp"

#include <algorithm>
#include <array>
#include <string>

namespace ecir {
namespace {

struct InputCase {
    uint32_t width, height;
    uint32_t d, interval;
    uint32_t block; ///< 0 for the device's
};

/// The last one: as in the network.
constexpr std::array<InputCase, 9> input_cases = {{
    {1, 1, 2, 0, 8},
    {1, 1, 3, 1, 8},
    {17, 5, 2, 0, 8},
    {17, 5, 14, 12, 16},
    {64, 3, 5, 3, 4},
    {65, 9, 4, 2, 8},
    {130, 2, 3, 1, 16},
    {3, 33, 14, 7, 1},
    {240, 180, 14, 7, 0},
}};

struct UpdateCase {
    uint32_t width, height;
    uint32_t d;
    uint32_t halo;
};

/// The last one: as in the network.
constexpr std::array<UpdateCase, 9> update_cases = {{
    {1, 1, 1, 1},
    {1, 1, 3, 0},
    {17, 5, 1, 0},
    {17, 5, 2, 1},
    {1, 19, 4, 1},
    {65, 3, 14, 1},
    {64, 2, 3, 2},
    {33, 11, 5, 0},
    {240, 180, 14, 1},
}};

std::string size_text(uint32_t width, uint32_t height) {
    return std::to_string(width) + "x" + std::to_string(height);
}

} // namespace

std::vector<double> reference::refine_input(std::span<const float> frames,
                                            std::span<const float> counts,
                                            std::span<const float> residuals, uint32_t interval,
                                            const ImageSize& size) {
    const auto channel = [&](std::span<const float> from, size_t c) {
        return from.subspan(c * size.pixels(), size.pixels());
    };
    std::vector<double> result;
    const auto append = [&](std::span<const float> values) {
        result.insert(result.end(), values.begin(), values.end());
    };
    append(channel(frames, interval));
    append(channel(frames, interval + 1));
    for (const uint32_t frame : {interval, interval + 1}) {
        const auto values = channel(frames, frame);
        for (size_t i = 0; i < values.size(); ++i) {
            result.push_back(i % size.width == 0 ? 0 : double{values[i - 1]} - values[i]);
        }
        for (size_t i = 0; i < values.size(); ++i) {
            result.push_back(i < size.width ? 0 : double{values[i - size.width]} - values[i]);
        }
    }
    append(channel(counts, 2 * size_t{interval}));
    append(channel(counts, 2 * size_t{interval} + 1));
    if (interval > 0) {
        append(channel(residuals, interval - 1));
    }
    return result;
}

std::vector<double> reference::refine_update(std::span<const float> initial,
                                             std::span<const float> frames,
                                             std::span<const float> residuals,
                                             const AlphaWeights& alpha, const ImageSize& size) {
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
                updated[at] = value - 0.1 * std::max(sum, 0.0) * direction;
            }
        }
    }
    return updated;
}

Trial refine_input_trial(Device& device, uint32_t trial) {
    const InputCase& shape = input_cases.at(trial);
    const reference::ImageSize size{shape.height, shape.width};
    const uint32_t block = case_block(device, shape.block);
    CaseRandom random(400 + trial);
    const uint32_t intervals = shape.d - 1;
    const auto frames = random.values(shape.d * size.pixels(), -0.5, 1.5);
    const auto residuals = random.values(intervals * size.pixels(), -1, 1);
    std::vector<float> counts(2 * intervals * size.pixels());
    for (float& count : counts) {
        count = static_cast<float>(random.integer(0, 9));
    }

    Trial result;
    result.shape = size_text(shape.width, shape.height) + " interval " +
                   std::to_string(shape.interval) + " of " + std::to_string(intervals) +
                   ", block " + std::to_string(block);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout frame_layout{shape.d, shape.height, shape.width, 1, 1, 0};
    // The inputs of trials with an odd number come blocked.
    const Layout count_layout{
        2 * intervals, shape.height, shape.width, trial % 2 == 0 ? 1U : 4U, 0, 0};
    const Layout residual_layout{intervals, shape.height, shape.width, trial % 2 == 0 ? 1U : 8U, 1,
                                 0};
    const Tensor frame_input = program.input(frame_layout);
    const Tensor count_input = program.input(count_layout);
    const Tensor residual_input = program.input(residual_layout);
    result.output =
        program.output({residual_channels(shape.interval), shape.height, shape.width, block, 1, 0});
    program.clear(result.output);
    result.first_step = program.steps();
    record_refine_input(program, frame_input, count_input, residual_input, shape.interval,
                        result.output);
    program.finish();
    program.write(frame_input, from_dense(frame_layout, frames));
    program.write(count_input, from_dense(count_layout, counts));
    program.write(residual_input, from_dense(residual_layout, residuals));
    result.reference = reference::refine_input(frames, counts, residuals, shape.interval, size);
    return result;
}

Trial refine_update_trial(Device& device, uint32_t trial) {
    const UpdateCase& shape = update_cases.at(trial);
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

    Trial result;
    result.shape = std::to_string(shape.d) + " frames " + size_text(shape.width, shape.height) +
                   " halo " + std::to_string(shape.halo);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout layout{shape.d, shape.height, shape.width, 1, shape.halo, 0};
    Layout between = layout;
    between.channels = shape.d - 1;
    const Tensor initial_input = program.input(layout);
    const Tensor frame_input = program.input(layout);
    Tensor residual_input;
    if (shape.d > 1) {
        residual_input = program.input(between);
    }
    result.output = program.output(layout);
    program.clear(result.output);
    result.first_step = program.steps();
    record_refine_update(program, initial_input, frame_input, residual_input, alpha, result.output);
    program.finish();
    program.write(initial_input, from_dense(layout, initial));
    program.write(frame_input, from_dense(layout, frames));
    if (shape.d > 1) {
        program.write(residual_input, from_dense(between, residuals));
    }
    result.reference = reference::refine_update(initial, frames, residuals, alpha, size);
    return result;
}

} // namespace ecir
