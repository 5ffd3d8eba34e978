#pragma once
#include <array>
#include <cstdint>

#include "runtime/program.hpp"

namespace ecir {

/// A symmetric filter along each axis of the image, first x, then y.
struct SmoothDesc {
    std::array<float, 5> weights{}; ///< of the middle and of the neighbours at 1 ... 4 steps
    uint32_t reach = 4;             ///< neighbours on either side
    uint32_t step = 1;              ///< pixels between them
    bool zero = false;              ///< outside the image are zeros, else the border's pixels
};

/// Records it; returns the filtered tensor. from: dense (block 1, no halo). Throws Error(bad_input)
/// where it is not, and for a reach beyond 4; finish() throws Error(resources) when it exceeds what
/// the device can bind.
Tensor record_smooth(Program& program, const SmoothDesc& desc, const Tensor& from);

} // namespace ecir
