#pragma once
#include <cstdint>
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

/// Input of the residual network of `interval` as record_refine_input() describes it, in double.
std::vector<double> refine_input(std::span<const float> frames, std::span<const float> counts,
                                 std::span<const float> residuals, uint32_t interval,
                                 const ImageSize& size);

/// The step that record_refine_update() describes, in double, for all d frames.
std::vector<double> refine_update(std::span<const float> initial, std::span<const float> frames,
                                  std::span<const float> residuals, const AlphaWeights& alpha,
                                  const ImageSize& size);

} // namespace ecir::reference

namespace ecir {

Trial refine_input_trial(Device& device, uint32_t trial);
Trial refine_update_trial(Device& device, uint32_t trial);

} // namespace ecir
