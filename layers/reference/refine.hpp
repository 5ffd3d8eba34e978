#pragma once
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "layers/operations.hpp"
#include "layers/refine.hpp"

namespace ecir::reference {

/// Size of the images that the references work on; tensors are dense channels x height x width.
struct ImageSize {
    uint32_t height;
    uint32_t width;
    [[nodiscard]] size_t pixels() const { return size_t{height} * width; }
};

/// The state that record_refine_state() writes, in double; the residuals' planes 0.
std::vector<double> refine_state(std::span<const float> frames, std::span<const float> counts,
                                 const ImageSize& size);

/// Dense planes of a state with these frames and residuals and zeros for everything else.
std::vector<float> update_state(std::span<const float> frames, std::span<const float> residuals,
                                const ImageSize& size);

/// The step that record_refine_update() describes, in double, for all d frames.
std::vector<double> refine_update(std::span<const float> initial, std::span<const float> frames,
                                  std::span<const float> residuals, const AlphaWeights& alpha,
                                  const ImageSize& size,
                                  float largest_step = std::numeric_limits<float>::infinity());

} // namespace ecir::reference

namespace ecir {

Trial refine_state_trial(Device& device, uint32_t trial);
Trial refine_update_trial(Device& device, uint32_t trial);
/// Of the same cases, the largest change.
Trial refine_largest_trial(Device& device, uint32_t trial);

} // namespace ecir
