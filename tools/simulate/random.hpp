#pragma once
#include <cmath>
#include <cstdint>
#include <numbers>

namespace ecir::sim {

/// SplitMix64 (Steele, Lea, Flood 2014): a counter through a mixer. One per pixel, so that no
/// pixel's draws depend on the others' or on their order; the distributions are written out because
/// the standard library's differ between implementations.
class Random {
public:
    Random() = default;
    /// Stream number `stream` of `seed`.
    Random(uint64_t seed, uint64_t stream) : state_(mix(seed ^ mix(stream + increment))) {}

    uint64_t bits() { return mix(state_ += increment); }
    /// In (0, 1], so that its logarithm is finite.
    double uniform() { return (static_cast<double>(bits() >> 11) + 1.0) * 0x1p-53; }
    double uniform(double low, double high) { return low + (high - low) * uniform(); }
    /// Standard normal, Box-Muller: sqrt(-2 ln u1) cos(2 pi u2).
    double normal() {
        const double radius = std::sqrt(-2.0 * std::log(uniform()));
        return radius * std::cos(2.0 * std::numbers::pi * uniform());
    }
    /// Waiting time of a Poisson process: -ln(u) / rate.
    double exponential(double rate) { return -std::log(uniform()) / rate; }

private:
    static constexpr uint64_t increment = 0x9E3779B97F4A7C15U;
    static uint64_t mix(uint64_t z) {
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
        return z ^ (z >> 31);
    }
    uint64_t state_ = 0;
};

} // namespace ecir::sim
