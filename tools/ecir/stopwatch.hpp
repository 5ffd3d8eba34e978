#pragma once
#include <chrono>

namespace ecir::cli {

/// Wall time since it was made.
class Stopwatch {
public:
    [[nodiscard]] double ms() const {
        const auto passed = std::chrono::steady_clock::now() - start_;
        return std::chrono::duration<double, std::milli>(passed).count();
    }

private:
    std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

} // namespace ecir::cli
