#pragma once
#include "layers/operations.hpp"
#include "tools/ecir/bench_report.hpp"

namespace ecir::cli {

/// Checks a case of an operation against its reference and, where it agrees, times it.
OperationRow bench_operation(const Operation& operation, Device& device, uint32_t trial,
                             const Roof& roof);

} // namespace ecir::cli
