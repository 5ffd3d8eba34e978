#pragma once
#include <sys/types.h>

#include <vector>

namespace ecir {

/// Gives each of the threads that lavapipe computes with a processor of its own, as many as it
/// starts for the processors that this thread may run on (Linux). lavapipe hands each the same
/// share of a dispatch; left to the scheduler two of them can stay on one processor for hundreds of
/// dispatches, as they sleep too often for its balancing: the fusion network took 0.33 s or, at
/// times, 0.50 s on two cores. With ECIR_PIN=0 in the environment everything stays where it is.
/// Best effort: no errors.
class DriverThreads {
public:
    /// Before a device is created.
    DriverThreads();
    /// After it was created, on the same thread: pins what it has started. Waits, 50 ms at most,
    /// until the driver's threads have named themselves.
    void pin() const;

private:
    std::vector<pid_t> before_; ///< ascending
};

} // namespace ecir
