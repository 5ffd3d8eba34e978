#include <doctest/doctest.h>

#include "layers/operations.hpp"

// The table that `ecir verify` runs, as tests: every case of every operation against its reference.
TEST_SUITE("operations") {
    TEST_CASE("every kernel agrees with its double-precision reference") {
        const auto device = ecir::Device::open();
        for (const ecir::Operation& operation : ecir::operations()) {
            for (uint32_t trial = 0; trial < operation.trials; ++trial) {
                const auto result = ecir::run_trial(operation, *device, trial);
                INFO(operation.name, " ", result.shape, ": error ", result.error);
                CHECK(result.ok);
            }
        }
    }
}
