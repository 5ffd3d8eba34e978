#include "tools/ecir/bench_operations.hpp"

#include <algorithm>

namespace ecir::cli {
namespace {

/// The operation's own dispatches, together.
DispatchTime profile(const Trial& trial) {
    const auto all = trial.program->profile();
    DispatchTime total;
    for (size_t i = trial.first_step; i < all.size(); ++i) {
        total.ms += all[i].ms;
        total.flops += all[i].flops;
        total.bytes += all[i].bytes;
    }
    return total;
}

} // namespace

OperationRow bench_operation(const Operation& operation, Device& device, uint32_t trial,
                             const Roof& roof) {
    const Trial made = operation.make(device, trial);
    const TrialResult checked = run_trial(operation, made);
    OperationRow row{std::string(operation.name), made.shape, checked.ok, checked.error, {}};
    if (!row.ok) {
        return row;
    }
    const DispatchTime work = profile(made);
    row.time = repeat([&] { return profile(made).ms; });
    row.gflops = work.flops / row.time.median_ms * 1e-6;
    row.gbs = work.bytes / row.time.median_ms * 1e-6;
    row.share = std::max(row.gflops / roof.gflops, row.gbs / roof.gbs);
    return row;
}

} // namespace ecir::cli
