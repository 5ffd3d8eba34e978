#pragma once
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/tensor.hpp"

namespace ecir {

/// Times at which the fusion network has frames of the prior, evenly from -1 to 1.
inline constexpr uint32_t anchor_count = 9;

/// How far from a time its frame still stands for the exposure: five even times from -1 to 1 cover
/// it.
inline constexpr double exposure_reach = 0.25;

/// What the kernels of the fusion network need to know of a wanted time.
struct Instant {
    float time = 0;     ///< normalised
    float place = 0;    ///< in gaps between anchors, from the first anchor
    uint32_t below = 0; ///< anchor before it; the last but one at the end
    /// By anchor: how many others are nearer to the time, the earlier of two at one distance.
    std::array<uint32_t, anchor_count> rank{};
    float share = 0; ///< of the exposure, among the wanted times (make_instants())
    std::array<uint32_t, 3> unused{};

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

/// The times of an exposure in any order. Their shares: of the exposure, what is nearer to a time
/// than to others, which adds up to 1 (the trapezoidal rule for even times from -1 to 1); 0 for all
/// where the times do not cover the exposure, that is where a part of it is further than
/// exposure_reach from them. Throws Error(bad_input) for a time outside [-1, 1].
std::vector<Instant> make_instants(std::span<const double> times);

} // namespace ecir
