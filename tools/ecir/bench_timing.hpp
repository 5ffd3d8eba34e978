#pragma once
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

namespace ecir::cli {

/// Of repeated runs.
struct Timing {
    double median_ms = 0;
    double first_quartile_ms = 0;
    double third_quartile_ms = 0;
    size_t runs = 0;
    [[nodiscard]] double spread_ms() const { return third_quartile_ms - first_quartile_ms; }
};

/// Repeats `once`, which returns how many milliseconds it took: 20 times and over 0.3 s, of what
/// takes long 5 times and over 3 s. Call it once before, so that caches are warm.
Timing repeat(const std::function<double()>& once);

/// Milliseconds on a clock that never goes back.
double now_ms();

/// The machine that this runs on.
struct Host {
    std::string cpu;    ///< model
    uint32_t cores = 0; ///< that this process may use
    std::string system; ///< distribution and kernel
};
Host this_host();

} // namespace ecir::cli
