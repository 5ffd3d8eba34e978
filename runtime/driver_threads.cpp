#include "runtime/driver_threads.hpp"

#if defined(__linux__)

#include <sched.h>
#include <sys/types.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

namespace ecir {
namespace {

constexpr const char* kTasks = "/proc/self/task";

/// Empty for a thread that is not this process's.
std::string thread_name(pid_t thread) {
    std::string name;
    std::getline(std::ifstream(kTasks + ("/" + std::to_string(thread)) + "/comm"), name);
    return name;
}

std::vector<int> processors() {
    cpu_set_t set;
    std::vector<int> found;
    if (sched_getaffinity(0, sizeof(set), &set) == 0) {
        for (int i = 0; i < CPU_SETSIZE; ++i) {
            if (CPU_ISSET(i, &set)) {
                found.push_back(i);
            }
        }
    }
    return found;
}

std::vector<pid_t> threads_named(const std::string& name) {
    std::vector<pid_t> found;
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(kTasks, ignored)) {
        const std::string text = entry.path().filename().string();
        pid_t thread = 0;
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), thread);
        if (error == std::errc{} && thread_name(thread) == name) {
            found.push_back(thread);
        }
    }
    return found;
}

void pin(pid_t thread, int processor) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(processor, &set);
    sched_setaffinity(thread, sizeof(set), &set);
}

} // namespace

void pin_driver_threads() {
    const char* wanted = std::getenv("ECIR_PIN");
    const std::vector<int> all = processors();
    if ((wanted != nullptr && std::string_view(wanted) == "0") || all.size() < 2) {
        return;
    }
    // The driver names its rasterizer's threads, one a processor: llvmpipe-0, ... Those for compute
    // it starts right after them, and they keep the name of the thread that opened the device: this
    // one. Each of the first names itself, on a busy machine only a while after it was started.
    const std::string last_name = "llvmpipe-" + std::to_string(all.size() - 1);
    constexpr int kTries = 50;
    std::vector<pid_t> lasts = threads_named(last_name);
    for (int i = 0; lasts.empty() && i < kTries; ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        lasts = threads_named(last_name);
    }
    std::vector<pid_t> ours = threads_named(thread_name(gettid()));
    std::ranges::sort(ours);
    for (const pid_t last : lasts) {
        const auto first = std::ranges::upper_bound(ours, last);
        if (static_cast<size_t>(ours.end() - first) >= all.size()) {
            for (size_t i = 0; i < all.size(); ++i) {
                pin(first[static_cast<std::ptrdiff_t>(i)], all[i]);
            }
        }
    }
}

} // namespace ecir

#else

namespace ecir {
void pin_driver_threads() {}
} // namespace ecir

#endif
