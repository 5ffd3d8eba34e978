#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "runtime/program.hpp"

namespace ecir {

/// One case of an operation: the finished program with its inputs written, and what it should
/// compute.
struct Trial {
    std::string shape; ///< for people, for example "3x3 s1 9->32 33x17"
    std::unique_ptr<Program> program;
    Tensor output;
    std::vector<double> reference; ///< dense channels x height x width of `output`
    size_t first_step = 0; ///< of the operation in the program; those before it prepare its input
};

/// A row of the table that drives the tests, `ecir verify` and `ecir bench`.
struct Operation {
    std::string_view name;
    /// Largest |output - reference| allowed, relative to the largest |reference|; 0 for exact.
    double tolerance;
    std::string_view reason; ///< why that tolerance
    uint32_t trials;         ///< how many small cases there are, for tests and `verify`
    Trial (*make)(Device& device, uint32_t trial);
    /// How many cases follow them that have the shapes of the networks at 240x180 with 14 frames,
    /// for `bench`: trial `trials`, `trials` + 1, ...
    uint32_t network_trials = 0;
    /// What a device must have for it, beside what everything needs.
    enum class Needs { nothing, float16, matrices };
    Needs needs = Needs::nothing;
};

/// All operations. Adding one adds a line here.
std::span<const Operation> operations();

/// Whether a device has what an operation needs.
bool runs_on(const Operation& operation, const DeviceInfo& info);

struct TrialResult {
    std::string shape;
    double error = 0; ///< relative to the largest |reference|
    bool ok =
        false; ///< error within tolerance, everything finite, the halo of the output still zero
};

/// Runs one case and compares.
TrialResult run_trial(const Operation& operation, const Trial& trial);
/// Makes it first.
TrialResult run_trial(const Operation& operation, Device& device, uint32_t index);

/// Elements of a tensor's memory as dense channels x height x width, and back (halo and padding
/// zero).
std::vector<float> to_dense(const Layout& layout, std::span<const float> memory);
std::vector<float> from_dense(const Layout& layout, std::span<const float> dense);

/// The channel block of a case: `block`, or what convolutions use on the device where that is 0.
uint32_t case_block(const Device& device, uint32_t block);

/// Small deterministic generator for the cases: the same numbers on every platform.
class CaseRandom {
public:
    explicit CaseRandom(uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ULL + 1) {}
    uint32_t next() {
        state_ ^= state_ << 13;
        state_ ^= state_ >> 7;
        state_ ^= state_ << 17;
        return static_cast<uint32_t>(state_ >> 32);
    }
    /// Uniform in [low, high).
    double uniform(double low, double high) { return low + (high - low) * (next() / 4294967296.0); }
    /// Uniform in low, ..., high.
    uint32_t integer(uint32_t low, uint32_t high) { return low + next() % (high - low + 1); }
    std::vector<float> values(size_t count, double low, double high) {
        std::vector<float> result(count);
        for (float& value : result) {
            value = static_cast<float>(uniform(low, high));
        }
        return result;
    }

private:
    uint64_t state_;
};

} // namespace ecir
