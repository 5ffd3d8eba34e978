#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/agreement.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// What record_agreement() computes, in double precision. differences: [reference_count][height]
/// [width]; frame: [height][width].
std::vector<double> agreement(std::span<const float> differences, std::span<const float> frame,
                              uint32_t width);

} // namespace ecir::reference

namespace ecir {

/// Cases of it (layers/agreement.hpp).
Trial agreement_trial(Device& device, uint32_t trial);

} // namespace ecir
