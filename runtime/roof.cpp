#include "runtime/roof.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <chrono>
#include <cmath>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "runtime/program.hpp"

namespace ecir {
namespace {

constexpr uint32_t kGroup = 64;    ///< invocations of a workgroup, in both shaders
constexpr uint32_t kUnrolled = 32; ///< steps of shaders/roof_multiply_add.comp a round
constexpr uint32_t kGroups = 4096; ///< of it: a quarter of a million invocations fill large GPUs
constexpr uint64_t kCopied = 64 << 20; ///< bytes
constexpr double kShortest = 10;       ///< ms that a measured dispatch takes at least

[[noreturn]] void fail(const Device& device, const std::string& kernel) {
    throw Error(ExitCode::device, "kernel " + kernel + " gives wrong results on " +
                                      device.info().name + "; ecir verify tells which others do");
}

/// Mirrors the push constants of shaders/roof_multiply_add.comp.
struct MultiplyAddPush {
    float a = 0.999F;
    float b = 0.0005F;
    uint32_t rounds = 1;

    /// What the kernel computes for one invocation.
    [[nodiscard]] double sum(uint32_t invocation, uint32_t chains) const {
        const double limit = double{b} / (1 - double{a});
        const double decay = std::pow(double{a}, double{kUnrolled} * rounds);
        double total = 0;
        for (uint32_t c = 0; c < chains; ++c) {
            total += limit + decay * ((invocation % kGroup + c) / 64.0 - limit);
        }
        return total;
    }
};
static_assert(sizeof(MultiplyAddPush) == 12);

/// Multiply-adds in so many chains, for so many rounds.
class MultiplyAdd {
public:
    MultiplyAdd(Device& device, uint32_t chains, uint32_t rounds)
        : program_(device), chains_(chains), push_{.rounds = rounds} {
        sum_ = program_.output({1, 1, kGroup * kGroups});
        const std::array<uint32_t, 1> constants{chains};
        Dispatch dispatch;
        dispatch.kernel = &device.kernel("roof_multiply_add", constants, 1, sizeof(push_));
        dispatch.arguments = {write(sum_)};
        dispatch.set_push(push_);
        dispatch.groups = {kGroups, 1, 1};
        dispatch.flops = 2.0 * kGroup * kGroups * kUnrolled * chains * rounds;
        program_.add(std::move(dispatch));
        program_.finish();
    }

    DispatchTime run() {
        DispatchTime time = program_.profile().front();
        const auto sums = program_.read(sum_);
        constexpr double kRounding = 1e-3; // of steps that shrink each error by a
        for (uint32_t i = 0; i < sums.size(); ++i) {
            const double expected = push_.sum(i, chains_);
            if (!(std::abs(double{sums[i]} - expected) <= kRounding * expected)) {
                fail(program_.device(), "roof_multiply_add");
            }
        }
        return time;
    }

private:
    Program program_;
    uint32_t chains_;
    MultiplyAddPush push_;
    Tensor sum_;
};

double multiply_add_gflops(Device& device) {
    double best = 0;
    // What hides the latency of two adders and multipliers, and what fits 16 registers beside a and
    // b.
    for (const uint32_t chains : {8U, 12U}) {
        uint32_t rounds = 16; // so many that an invocation's start and end do not count
        (void)MultiplyAdd(device, chains, rounds).run(); // compiles, wakes the device
        constexpr uint32_t kMostRounds = 1U << 15;       // lavapipe leaves loops after 2^16
        while (rounds < kMostRounds && MultiplyAdd(device, chains, rounds).run().ms < kShortest) {
            rounds *= 2;
        }
        MultiplyAdd work(device, chains, rounds);
        for (int i = 0; i < 10; ++i) {
            const DispatchTime time = work.run();
            best = std::max(best, time.flops / time.ms * 1e-6);
        }
    }
    return best;
}

/// Workgroups along x and y for as many in all.
std::array<uint32_t, 3> spread(const DeviceInfo& info, uint32_t groups) {
    uint32_t columns = groups;
    while (columns > info.max_groups[0]) {
        columns /= 2;
    }
    return {columns, groups / columns, 1};
}

double copy_gbs(Device& device) {
    constexpr uint64_t kGroupBytes = uint64_t{kGroup} * 16;
    const uint64_t bytes = std::bit_floor(
        std::min({kCopied, device.info().max_storage_range, device.info().heap_bytes / 16}));
    const auto elements = static_cast<uint32_t>(bytes / 4);
    Program program(device);
    const Tensor from = program.input({1, 1, elements});
    const Tensor to = program.output({1, 1, elements});
    for (int i = 0; i < 8; ++i) {
        Dispatch dispatch;
        dispatch.kernel = &device.kernel("roof_copy", {}, 2, 0);
        dispatch.arguments = {read(from), write(to)};
        dispatch.groups = spread(device.info(), static_cast<uint32_t>(bytes / kGroupBytes));
        dispatch.bytes = 2.0 * static_cast<double>(bytes);
        program.add(std::move(dispatch));
    }
    program.finish();
    std::vector<float> values(elements);
    for (uint32_t i = 0; i < elements; ++i) {
        values[i] =
            static_cast<float>(i); // rounded, but from neighbour to neighbour distinct enough
    }
    program.write(from, values);
    double best = 0;
    for (int i = 0; i < 3; ++i) {
        for (const DispatchTime& time : program.profile()) {
            best = std::max(best, time.bytes / time.ms * 1e-6);
        }
    }
    if (!std::ranges::equal(program.read(to), values)) {
        fail(device, "roof_copy");
    }
    return best;
}

/// Median wall time of a run in microseconds.
double median_run_us(Program& program, int runs) {
    program.run();
    std::vector<double> times;
    for (int i = 0; i < runs; ++i) {
        const auto start = std::chrono::steady_clock::now();
        program.run();
        times.push_back(
            std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - start)
                .count());
    }
    std::ranges::nth_element(times, times.begin() + runs / 2);
    return times[static_cast<size_t>(runs) / 2];
}

} // namespace

Roof measure_roof(Device& device) {
    return {multiply_add_gflops(device), copy_gbs(device)};
}

Overhead measure_overhead(Device& device) {
    Program empty(device);
    empty.finish();
    constexpr int kDispatches = 500;
    Program many(device);
    const Tensor from = many.temporary({1, 1, 4 * kGroup});
    const Tensor to = many.temporary(from.layout());
    many.clear(from);
    for (int i = 0; i < kDispatches; ++i) {
        Dispatch dispatch;
        dispatch.kernel = &device.kernel("roof_copy", {}, 2, 0);
        dispatch.arguments = {read(from), write(to)};
        many.add(std::move(dispatch));
    }
    many.finish();
    Overhead overhead;
    overhead.submit_us = median_run_us(empty, 100);
    overhead.dispatch_us = (median_run_us(many, 20) - overhead.submit_us) / kDispatches;
    return overhead;
}

} // namespace ecir
