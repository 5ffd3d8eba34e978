#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/tensor.hpp"

namespace ecir {

/// Times at which the fusion network has frames of the prior, evenly from -1 to 1.
inline constexpr uint32_t anchor_count = 9;

/// What the kernels of the fusion network need to know of a wanted time.
struct Instant {
    float time = 0;     ///< normalised
    float place = 0;    ///< in gaps between anchors, from the first anchor
    uint32_t below = 0; ///< anchor before it; the last but one at the end
    /// By anchor: how many others are nearer to the time, the earlier of two at one distance.
    std::array<uint32_t, anchor_count> rank{};
    std::array<uint32_t, 4> unused{};

    Instant() = default;
    /// Throws Error(bad_input) for a time outside [-1, 1].
    explicit Instant(double normalised);
};
static_assert(sizeof(Instant) == 64);

/// Of the tensor of `count` instants, a channel each.
inline Layout instant_layout(uint32_t count) {
    return {count, 1, sizeof(Instant) / 4};
}

inline bool is_instant(const Tensor& tensor) {
    return tensor.layout().elements() == instant_layout(1).elements();
}

/// Throws Error(bad_input) for a time outside [-1, 1].
std::vector<Instant> make_instants(std::span<const double> times);

} // namespace ecir
