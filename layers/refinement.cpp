#include "layers/refinement.hpp"

#include <algorithm>
#include <array>

#include "runtime/error.hpp"

namespace ecir {
namespace {

/// Where the network's input channels (frame i, frame i + 1, d/dx and d/dy of each, positive and
/// other events, and from interval 1 on residual i - 1) lie among the planes of its input.
constexpr std::array<uint32_t, refine_network_inputs> kPlaneOfChannel{0, 6, 1, 2, 7, 8, 3, 4, 5};

/// conv3x3 to hidden channels, ReLU, conv3x3 to one channel, from the tensors of a weights file.
/// plane_of: for each input channel its channel in the tensor that is read, which has `planes`.
ConvPair load(Device& device, const SafeTensors& weights, const std::string& name,
              std::span<const uint32_t> plane_of, uint32_t planes) {
    const auto& shape = weights.get(name + ".0.weight").shape;
    const uint32_t hidden = shape.empty() ? 0 : shape.front();
    const auto channels = static_cast<uint32_t>(plane_of.size());
    const auto& first = weights.get(name + ".0.weight", {hidden, channels, 3, 3});
    std::vector<float> moved(size_t{hidden} * planes * 9);
    for (size_t o = 0; o < hidden; ++o) {
        for (size_t i = 0; i < channels; ++i) {
            std::copy_n(first.begin() + static_cast<std::ptrdiff_t>((o * channels + i) * 9), 9,
                        moved.begin() +
                            static_cast<std::ptrdiff_t>((o * planes + plane_of[i]) * 9));
        }
    }
    return {device, planes, hidden, moved, weights.get(name + ".2.weight", {1, hidden, 3, 3})};
}

constexpr std::array<uint32_t, 1> kFrame{0};

} // namespace

Refinement::Refinement(Device& device, const SafeTensors& weights, bool bounded)
    : first_residual_(load(device, weights, "refine.first_res_net",
                           std::span(kPlaneOfChannel).first(refine_network_inputs - 1),
                           refine_network_inputs)),
      other_residual_(
          load(device, weights, "refine.other_res_net", kPlaneOfChannel, refine_network_inputs)),
      polish_(load(device, weights, "refine.final", kFrame, 1)), bounded_(bounded) {
    std::ranges::copy(weights.get("refine.alpha_net.weight", {1, 1, 3, 3}), alpha_.begin());
    alpha_.back() = weights.get("refine.alpha_net.bias", {1}).front();
}

Tensor Refinement::record(Program& program, const Tensor& initial, const Tensor& counts,
                          const Tensor& refined, uint32_t iterations, uint32_t trained,
                          float settled) const {
    const Layout& layout = initial.layout();
    const uint32_t count = layout.channels;
    // The halos are cleared once; every iteration writes the insides anew.
    const Tensor frames = program.cleared(layout);
    const Tensor state = program.cleared(refine_state_layout(count, layout.height, layout.width));
    const Tensor progress = program.output(progress_layout(iterations));
    program.clear(progress);
    const uint32_t at_once = images_at_once(program.device().info(), layout.height, layout.width);
    std::vector<Tensor> scratch;
    for (uint32_t i = 0; i < std::min(at_once, count); ++i) {
        scratch.push_back(ConvPair::scratch(
            program,
            std::max({first_residual_.hidden(), other_residual_.hidden(), polish_.hidden()}),
            layout.height, layout.width));
    }
    // An iteration that nothing ends early begins where the one before has done with two frames.
    const uint32_t together = at_once > 1 && settled == 0 ? 1 : UINT32_MAX;

    const float largest =
        bounded_ ? largest_refine_step(count) : std::numeric_limits<float>::infinity();
    for (uint32_t iteration = 0; iteration < iterations; ++iteration) {
        const auto step = [&] {
            // The residuals of an iteration wait for one another anyway.
            const Tensor& between = scratch[iteration % scratch.size()];
            const bool first = iteration == 0;
            record_refine_state(program, first ? initial : frames,
                                first && count > 1 ? &counts : nullptr, state, together);
            for (uint32_t i = 0; i + 1 < count; ++i) {
                (i == 0 ? first_residual_ : other_residual_)
                    .record(program, refine_network_input(state, i), between,
                            refine_residual(state, i));
            }
            record_refine_update(program, initial, state, alpha_, frames,
                                 progress.channels(iteration, 1), largest, together);
        };
        if (iteration == 0 || settled == 0) {
            step();
        } else {
            const Tensor moving = progress.channels(iterations + iteration, 1);
            // An iteration left out has changed nothing, so those after it are left out as well.
            std::optional<Tensor> before;
            if (iteration >= trained && iteration > 1) {
                before = progress.channels(iteration - 2, 1);
            }
            record_refine_settled(program, progress.channels(iteration - 1, 1), settled, before,
                                  moving);
            program.when(moving, step);
        }
    }
    for (uint32_t i = 0; i < count; ++i) {
        polish_.record(program, frames.channels(i, 1), scratch[(iterations + i) % scratch.size()],
                       refined.channels(i, 1));
    }
    return progress;
}

} // namespace ecir
