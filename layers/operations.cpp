#include "layers/operations.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "layers/conv.hpp"
#include "layers/reference/agreement.hpp"
#include "layers/reference/consistency.hpp"
#include "layers/reference/conv.hpp"
#include "layers/reference/curve.hpp"
#include "layers/reference/edi.hpp"
#include "layers/reference/elementwise.hpp"
#include "layers/reference/fusion_mix.hpp"
#include "layers/reference/histogram.hpp"
#include "layers/reference/keypoints.hpp"
#include "layers/reference/motion.hpp"
#include "layers/reference/prior.hpp"
#include "layers/reference/refine.hpp"
#include "layers/reference/trajectory.hpp"

namespace ecir {
namespace {

constexpr std::array kOperations = {
    Operation{"conv", 1e-5, "float32 sums of up to 2000 products", 17, conv_trial},
    Operation{"conv_row", 1e-5, "float32 sums of up to 2000 products", 17, conv_row_trial, 59},
    Operation{"conv_tile", 1e-5, "float32 sums of up to 2000 products", 34, conv_tile_trial, 3},
    Operation{"conv_tile_half", 2e-3, "float16 factors, float16 sums of up to 20 products", 34,
              conv_tile_half_trial, 3, Operation::Needs::float16},
    Operation{"conv_matrix", 2e-3, "float16 factors, float32 sums of up to 2000 products", 34,
              conv_matrix_trial, 3, Operation::Needs::matrices},
    Operation{"conv_plane", 1e-5, "float32 sums of up to 400 products", 8, conv_plane_trial},
    Operation{"conv_pair", 1e-5, "float32 sums of up to 700 products", 8, conv_pair_trial, 5},
    Operation{"event_histogram", 0, "counts are whole numbers", 10, event_histogram_trial, 2},
    Operation{"keypoints", 0, "compared as integers", 12, keypoints_trial, 1},
    Operation{"curve", 1e-5, "float32 products of up to 20 differences", 12, curve_trial, 1},
    Operation{"curve_order", 1e-5, "float32 products of up to 20 differences", 12,
              curve_order_trial, 1},
    Operation{"refine_state", 1e-6, "one float32 difference", 8, refine_state_trial, 1},
    Operation{"refine_update", 1e-5, "float32 sums of 9 products", 8, refine_update_trial, 1},
    Operation{"refine_largest", 1e-5, "float32 sums of 9 products", 9, refine_largest_trial},
    Operation{"elementwise", 1e-6, "one float32 operation, or an exponential", 12,
              elementwise_trial, 2},
    Operation{"edi", 1e-5, "float32 sums of exponentials, one an event", 10, edi_trial, 1},
    Operation{"edi_moments", 1e-5, "float32 sums of squares", 4, edi_moments_trial, 1},
    Operation{"prior", 1e-5, "float32 sums of exponentials, one an event", 40, prior_trial, 1},
    Operation{"prior_frame", 1e-5, "float32 exponentials", 10, prior_frame_trial, 1},
    Operation{"motion", 1e-5, "float32 differences of logarithms", 9, motion_trial, 1},
    Operation{"motion_oblique", 1e-4, "along stripes the moments' rounding over the ridge", 2,
              motion_oblique_trial},
    Operation{"trajectory", 1e-5, "8 float32 steps", 9, trajectory_trial, 1},
    Operation{"fusion_fetch", 1e-5, "float32 positions", 9, fusion_fetch_trial, 1},
    Operation{"reference_fetch", 1e-5, "float32 positions", 9, reference_fetch_trial, 1},
    Operation{"agreement", 1e-5, "float32 exponentials", 6, agreement_trial, 1},
    Operation{"fusion_mix", 1e-6, "float32 sums of 4 products", 7, fusion_mix_trial, 1},
    Operation{"consistency", 1e-6, "float32 sums of up to 14 differences", 5, consistency_trial, 1},
};

} // namespace

std::span<const Operation> operations() {
    return kOperations;
}

bool runs_on(const Operation& operation, const DeviceInfo& info) {
    return operation.needs == Operation::Needs::nothing ||
           (operation.needs == Operation::Needs::float16 && has_float16(info)) ||
           (operation.needs == Operation::Needs::matrices &&
            info.matrices.form != Matrices::Form::none);
}

TrialResult run_trial(const Operation& operation, Device& device, uint32_t index) {
    return run_trial(operation, operation.make(device, index));
}

TrialResult run_trial(const Operation& operation, const Trial& trial) {
    trial.program->run();
    const auto memory = trial.program->read(trial.output);
    const Layout& layout = trial.output.layout();
    const auto values = to_dense(layout, memory);

    TrialResult result{trial.shape, 0, values.size() == trial.reference.size()};
    double largest = 0;
    double error = 0;
    for (size_t i = 0; result.ok && i < values.size(); ++i) {
        result.ok = std::isfinite(values[i]);
        largest = std::max(largest, std::abs(trial.reference[i]));
        error = std::max(error, std::abs(double{values[i]} - trial.reference[i]));
    }
    result.error =
        result.ok ? error / std::max(largest, 1e-30) : std::numeric_limits<double>::infinity();
    // Whatever is not a pixel is halo or channel padding, where the next layer expects zeros.
    const auto clean = from_dense(layout, values);
    result.ok =
        result.ok && result.error <= operation.tolerance && std::ranges::equal(clean, memory);
    return result;
}

std::vector<float> to_dense(const Layout& layout, std::span<const float> memory) {
    std::vector<float> dense;
    dense.reserve(size_t{layout.channels} * layout.height * layout.width);
    for (uint32_t c = 0; c < layout.channels; ++c) {
        for (uint32_t y = 0; y < layout.height; ++y) {
            for (uint32_t x = 0; x < layout.width; ++x) {
                dense.push_back(memory[layout.offset(c, y, x)]);
            }
        }
    }
    return dense;
}

std::vector<float> from_dense(const Layout& layout, std::span<const float> dense) {
    std::vector<float> memory(layout.elements());
    size_t i = 0;
    for (uint32_t c = 0; c < layout.channels; ++c) {
        for (uint32_t y = 0; y < layout.height; ++y) {
            for (uint32_t x = 0; x < layout.width; ++x) {
                memory[layout.offset(c, y, x)] = dense[i++];
            }
        }
    }
    return memory;
}

uint32_t case_block(const Device& device, uint32_t block) {
    return block != 0 ? block : channel_block(device.info());
}

} // namespace ecir
