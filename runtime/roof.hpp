#pragma once
#include "runtime/device.hpp"

namespace ecir {

/// What kernels reach on a device at most, in float32.
struct Roof {
    double gflops = 0; ///< of multiply-adds in registers, 2 operations each; 1e9 a second
    double gbs = 0; ///< of a copy between two large buffers, read and written; 1e9 bytes a second
};

/// The fastest of several runs of shaders/roof_multiply_add.comp and shaders/roof_copy.comp, their
/// results checked. Throws Error(device) where the device has no timestamps or computes something
/// else.
Roof measure_roof(Device& device);

/// What launching work costs, beside the work.
struct Overhead {
    double submit_us = 0;   ///< submitting an empty program and waiting for it; median
    double dispatch_us = 0; ///< one more small dispatch in a program, a barrier before it; median
};

Overhead measure_overhead(Device& device);

} // namespace ecir
