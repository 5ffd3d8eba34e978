#pragma once
#include <stdexcept>
#include <string>

namespace ecir {

/// Exit codes of the command line; every Error carries the one it ends with.
enum class ExitCode : int {
    ok = 0,
    check_failed = 1, ///< verify or eval found a figure outside its bound
    usage = 2,        ///< wrong options, or an output that exists already
    bad_input = 3,    ///< a file that cannot be read as what it should be
    device = 4,       ///< no usable Vulkan device, or the device failed
    resources = 5,    ///< out of memory or disk
};

/// What happened, where, and what to do about it, in one message for a person.
class Error : public std::runtime_error {
public:
    Error(ExitCode code, const std::string& message) : std::runtime_error(message), code_(code) {}
    [[nodiscard]] ExitCode code() const noexcept { return code_; }

private:
    ExitCode code_;
};

} // namespace ecir
