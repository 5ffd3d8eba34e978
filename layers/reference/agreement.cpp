#include "layers/reference/agreement.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "layers/elementwise.hpp"

namespace ecir::reference {

std::vector<double> agreement(std::span<const float> differences, std::span<const float> frame,
                              uint32_t width) {
    const auto columns = static_cast<int64_t>(width);
    const int64_t rows = static_cast<int64_t>(frame.size()) / columns;
    std::vector<double> result(frame.size());
    for (int64_t p = 0; p < rows * columns; ++p) {
        double sum = 0;
        double weights = 1;
        for (size_t i = 0; i < reference_count; ++i) {
            const auto plane = differences.subspan(i * frame.size(), frame.size());
            double squares = 0;
            for (int64_t k = 0; k < 9; ++k) {
                const int64_t y = std::clamp<int64_t>(p / columns + k / 3 - 1, 0, rows - 1);
                const int64_t x = std::clamp<int64_t>(p % columns + k % 3 - 1, 0, columns - 1);
                const double difference = plane[static_cast<size_t>(y * columns + x)];
                squares += difference * difference;
            }
            const double tolerance = agreement_tolerance;
            const double weight = std::exp(-squares / 9 / (tolerance * tolerance));
            sum += weight * plane[static_cast<size_t>(p)];
            weights += weight;
        }
        result[static_cast<size_t>(p)] = frame[static_cast<size_t>(p)] + sum / weights;
    }
    return result;
}

} // namespace ecir::reference

namespace ecir {
namespace {

struct Case {
    uint32_t height, width;
    uint32_t halo; ///< of the frame and of the result
    double apart;  ///< frames differ by up to
};

/// The last one: as in the network.
constexpr std::array<Case, 7> cases = {{
    {7, 9, 0, 0.03},
    {3, 65, 1, 0.01},
    {1, 130, 3, 0.05},
    {1, 1, 1, 0.02},
    {17, 1, 2, 1},
    {45, 61, 1, 0.04},
    {180, 240, 0, 0.03},
}};

} // namespace

Trial agreement_trial(Device& device, uint32_t trial) {
    const auto [height, width, halo, apart] = cases.at(trial);
    CaseRandom random(1500 + trial);
    Trial result;
    result.shape = std::to_string(width) + "x" + std::to_string(height) + " halo " +
                   std::to_string(halo) + ", apart by " + std::to_string(apart);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout layout{1, height, width, 1, halo};
    const size_t pixels = size_t{height} * width;
    const auto values = random.values(reference_count * pixels, -apart, apart);
    const auto own = random.values(pixels, 0, 1);
    const Tensor differences = program.input({reference_count, height, width});
    const Tensor frame = program.input(layout);
    result.output = program.output(layout);
    program.clear(result.output);
    result.first_step = program.steps();
    record_agreement(program, differences, frame, result.output);
    program.finish();
    program.write(differences, values);
    program.write(frame, from_dense(layout, own));
    result.reference = reference::agreement(values, own, width);
    return result;
}

} // namespace ecir
