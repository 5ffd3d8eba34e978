#include "tools/ecir/bench_timing.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <sched.h>
#include <string_view>
#include <sys/utsname.h>
#include <vector>

namespace ecir::cli {
namespace {

/// What follows `key` and one of the separators in the first line of a file that starts with it.
std::string field(const char* file, std::string_view key, const char* separators) {
    std::ifstream in(file);
    for (std::string line; std::getline(in, line);) {
        const size_t separator = line.find_first_of(separators);
        if (line.starts_with(key) && separator != std::string::npos) {
            std::string value = line.substr(separator + 1);
            std::erase(value, '"');
            value.erase(0, value.find_first_not_of(' '));
            return value;
        }
    }
    return {};
}

/// By linear interpolation between sorted values.
double quantile(const std::vector<double>& sorted, double share) {
    const double place = share * static_cast<double>(sorted.size() - 1);
    const auto below = static_cast<size_t>(place);
    const size_t above = std::min(below + 1, sorted.size() - 1);
    return std::lerp(sorted[below], sorted[above], place - static_cast<double>(below));
}

} // namespace

double now_ms() {
    return std::chrono::duration<double, std::milli>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
}

Timing repeat(const std::function<double()>& once) {
    std::vector<double> times;
    const double start = now_ms();
    const auto enough = [&] {
        const double passed = now_ms() - start;
        return (times.size() >= 20 && passed > 300) || (times.size() >= 5 && passed > 3000);
    };
    while (!enough()) {
        times.push_back(once());
    }
    std::ranges::sort(times);
    return {quantile(times, 0.5), quantile(times, 0.25), quantile(times, 0.75), times.size()};
}

Host this_host() {
    Host host;
    host.cpu = field("/proc/cpuinfo", "model name", ":");
    cpu_set_t usable;
    CPU_ZERO(&usable);
    if (::sched_getaffinity(0, sizeof(usable), &usable) == 0) {
        host.cores = static_cast<uint32_t>(CPU_COUNT(&usable));
    }
    utsname kernel{};
    ::uname(&kernel);
    if (host.cpu.empty()) { // some architectures name none
        host.cpu = kernel.machine;
    }
    const std::string distribution = field("/etc/os-release", "PRETTY_NAME", "=");
    host.system =
        (distribution.empty() ? "" : distribution + ", ") + kernel.sysname + " " + kernel.release;
    return host;
}

} // namespace ecir::cli
