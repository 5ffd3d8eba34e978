#include "layers/refinement.hpp"

#include <algorithm>
#include <array>

#include "runtime/error.hpp"

namespace ecir {
namespace {

/// Channels between the two convolutions of a pair, read from the weight of the first.
uint32_t hidden_channels(const SafeTensors& weights, const std::string& name) {
    const auto& shape = weights.get(name).shape;
    return shape.empty() ? 0 : shape.front();
}

} // namespace

Refinement::Pair::Pair(Device& device, const SafeTensors& weights, const std::string& name,
                       uint32_t channels)
    : expand(
          device,
          {.out_channels = hidden_channels(weights, name + ".0.weight"), .kernel = 3, .relu = true},
          {channel_range(0, channels)},
          weights.get(name + ".0.weight",
                      {hidden_channels(weights, name + ".0.weight"), channels, 3, 3}),
          {}),
      project(
          device, hidden_channels(weights, name + ".0.weight"), 3,
          weights.get(name + ".2.weight", {1, hidden_channels(weights, name + ".0.weight"), 3, 3})),
      hidden(hidden_channels(weights, name + ".0.weight")) {}

void Refinement::Pair::record(Program& program, const Tensor& input, const Tensor& output) const {
    const Layout& size = input.layout();
    const Tensor between = program.temporary(
        {hidden, size.height, size.width, channel_block(program.device().info()), 0});
    expand.record(program, input, between);
    project.record(program, between, output);
}

Refinement::Refinement(Device& device, const SafeTensors& weights)
    : first_residual_(device, weights, "refine.first_res_net", residual_channels(0)),
      other_residual_(device, weights, "refine.other_res_net", residual_channels(1)),
      polish_(device, weights, "refine.final", 1) {
    std::ranges::copy(weights.get("refine.alpha_net.weight", {1, 1, 3, 3}), alpha_.begin());
    alpha_.back() = weights.get("refine.alpha_net.bias", {1}).front();
}

void Refinement::record(Program& program, const Tensor& initial, const Tensor& counts,
                        const Tensor& refined, uint32_t iterations) const {
    const Layout& frames = initial.layout();
    const uint32_t count = frames.channels;
    const uint32_t block = channel_block(program.device().info());
    // The halos are cleared once; every interval writes the insides anew.
    const auto cleared = [&](const Layout& layout) {
        const Tensor made = program.temporary(layout);
        program.clear(made);
        return made;
    };
    const std::array<Tensor, 2> steps = {cleared(frames), cleared(frames)};
    const Tensor residuals =
        program.temporary({std::max(count, 2U) - 1, frames.height, frames.width, 1, 0});
    const std::array<Tensor, 2> inputs = {
        cleared({residual_channels(0), frames.height, frames.width, block, 1}),
        cleared({residual_channels(1), frames.height, frames.width, block, 1})};

    Tensor current = initial;
    for (uint32_t iteration = 0; iteration < iterations; ++iteration) {
        for (uint32_t i = 0; i + 1 < count; ++i) {
            const Tensor& input = inputs.at(i == 0 ? 0 : 1);
            record_refine_input(program, current, counts, residuals, i, input);
            (i == 0 ? first_residual_ : other_residual_)
                .record(program, input, residuals.channels(i, 1));
        }
        const Tensor& next = steps.at(iteration % 2);
        record_refine_update(program, initial, current, residuals, alpha_, next);
        current = next;
    }
    for (uint32_t i = 0; i < count; ++i) {
        polish_.record(program, current.channels(i, 1), refined.channels(i, 1));
    }
}

} // namespace ecir
