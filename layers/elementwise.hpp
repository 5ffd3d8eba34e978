#pragma once
#include "runtime/program.hpp"

namespace ecir {

/// Operations on every element of tensors of one shape and one block; halos may differ. A result
/// may be one of the operands; its halo and what fills up its last block are left alone. All throw
/// Error(bad_input) where shapes disagree and Error(resources) when one block of channels exceeds
/// what the device can bind.

/// Records result = 1 / (1 + exp(-a)).
void record_sigmoid(Program& program, const Tensor& a, const Tensor& result);

/// Records result = a b.
void record_multiply(Program& program, const Tensor& a, const Tensor& b, const Tensor& result);

/// Records result = a + b, or max(a + b, 0). b may also be one channel that each of a's gets; block
/// 1 then.
void record_add(Program& program, const Tensor& a, const Tensor& b, const Tensor& result,
                bool relu = false);

} // namespace ecir
