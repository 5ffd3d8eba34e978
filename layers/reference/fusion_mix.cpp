#include "layers/reference/fusion_mix.hpp"

#include <array>
#include <string>

namespace ecir::reference {

std::vector<double> fusion_mix(std::span<const float> features, double time) {
    const size_t size = features.size() / fusion_basis;
    std::vector<double> mixed(size);
    std::array<double, fusion_basis> basis = {1, time};
    for (size_t k = 2; k < basis.size(); ++k) { // Chebyshev's recurrence
        basis.at(k) = 2 * time * basis.at(k - 1) - basis.at(k - 2);
    }
    for (size_t i = 0; i < size; ++i) {
        for (size_t k = 0; k < basis.size(); ++k) {
            mixed[i] += basis.at(k) * features[k * size + i];
        }
    }
    return mixed;
}

} // namespace ecir::reference

namespace ecir {
namespace {

struct Case {
    uint32_t channels, height, width;
    uint32_t block; ///< 0 for the device's
    double time;
};

/// The last one: as in the network.
constexpr std::array<Case, 8> cases = {{
    {48, 5, 7, 8, -1},
    {16, 3, 65, 16, 0.3},
    {20, 9, 4, 8, -0.7}, // the last block is not full
    {3, 1, 1, 4, 1},
    {80, 11, 33, 16, 0},
    {1, 2, 130, 8, 0.9},
    {12, 5, 9, 1, 0.2},
    {48, 45, 60, 1, 0.3},
}};

} // namespace

Trial fusion_mix_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.block = case_block(device, shape.block);
    CaseRandom random(1200 + trial);
    Trial result;
    result.shape = std::to_string(shape.channels) + " channels " + std::to_string(shape.width) +
                   "x" + std::to_string(shape.height) + " block " + std::to_string(shape.block);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout layout{shape.channels, shape.height, shape.width, shape.block};
    const Layout sets = fusion_basis_layout(layout);
    const Tensor input = program.input(sets);
    const Tensor instants = program.input(instant_layout(2));
    result.output = program.output(layout);
    result.first_step = program.steps();
    record_fusion_mix(program, input, instants.channels(1, 1), result.output);
    program.finish();

    const Instant instant(shape.time);
    const size_t used = size_t{shape.channels} * shape.height * shape.width;
    const auto values = random.values(fusion_basis * used, -1, 1);
    std::vector<float> padded; // with zeros for what fills up the last block of a set
    for (size_t k = 0; k < fusion_basis; ++k) {
        const auto set = std::span(values).subspan(k * used, used);
        padded.insert(padded.end(), set.begin(), set.end());
        padded.resize((k + 1) * (size_t{sets.channels} / fusion_basis) * shape.height *
                      shape.width);
    }
    program.write(input, from_dense(sets, padded));
    const std::vector<Instant> both = {Instant(0.5), instant};
    program.write(instants, std::as_bytes(std::span(both)));
    result.reference = reference::fusion_mix(values, double{instant.time});
    return result;
}

} // namespace ecir
