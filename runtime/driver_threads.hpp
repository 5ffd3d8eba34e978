#pragma once

namespace ecir {

/// Gives each of the threads that lavapipe computes with a processor of its own, where it has one
/// for every processor that this thread may run on (Linux). lavapipe hands each the same share of a
/// dispatch; left to the scheduler two of them can stay on one processor for hundreds of
/// dispatches, as they sleep too often for its balancing: the fusion network took 0.33 s or, at
/// times, 0.50 s on two cores. Threads with other numbers (LP_NUM_THREADS), and everything with
/// ECIR_PIN=0 in the environment, stay where they are. Best effort: no errors.
void pin_driver_threads();

} // namespace ecir
