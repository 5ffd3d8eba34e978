#pragma once
#include "layers/operations.hpp"

namespace ecir {

/// Cases of layers/elementwise.hpp; their reference is the operation itself, in double.
Trial elementwise_trial(Device& device, uint32_t trial);

} // namespace ecir
