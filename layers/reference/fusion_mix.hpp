#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/fusion_mix.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// What record_fusion_mix() computes, in double precision; features: fusion_basis sets.
std::vector<double> fusion_mix(std::span<const float> features, double time);

} // namespace ecir::reference

namespace ecir {

/// Cases of record_fusion_mix() (layers/fusion_mix.hpp).
Trial fusion_mix_trial(Device& device, uint32_t trial);

} // namespace ecir
