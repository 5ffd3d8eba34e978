#include "runtime/driver_threads.hpp"

#if defined(__linux__)

#include <sched.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <thread>
#include <tuple>
#include <utility>

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

std::vector<pid_t> threads() {
    std::vector<pid_t> found;
    std::error_code ignored;
    for (const auto& entry : std::filesystem::directory_iterator(kTasks, ignored)) {
        const std::string text = entry.path().filename().string();
        pid_t thread = 0;
        const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), thread);
        if (error == std::errc{}) {
            found.push_back(thread);
        }
    }
    std::ranges::sort(found);
    return found;
}

void pin_to(pid_t thread, int processor) {
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(processor, &set);
    sched_setaffinity(thread, sizeof(set), &set);
}

/// The number in the name of one of lavapipe's rasterizer's threads, else -1.
int rasterizer_index(const std::string& name) {
    constexpr std::string_view kPrefix = "llvmpipe-";
    int index = -1;
    if (name.starts_with(kPrefix)) {
        std::from_chars(name.data() + kPrefix.size(), name.data() + name.size(), index);
    }
    return index;
}

/// Of the threads, the one with the highest rasterizer_index(), and that; {0, -1} where none has
/// one.
std::pair<pid_t, int> last_rasterizer(const std::vector<pid_t>& among) {
    std::pair<pid_t, int> last{0, -1};
    for (const pid_t thread : among) {
        const int index = rasterizer_index(thread_name(thread));
        if (index > last.second) {
            last = {thread, index};
        }
    }
    return last;
}

} // namespace

DriverThreads::DriverThreads() : before_(threads()) {}

void DriverThreads::pin() const {
    const char* wanted = std::getenv("ECIR_PIN");
    const std::vector<int> all = processors();
    if ((wanted != nullptr && std::string_view(wanted) == "0") || all.size() < 2) {
        return;
    }
    std::vector<pid_t> started;
    std::ranges::set_difference(threads(), before_, std::back_inserter(started));
    // The driver names its rasterizer's threads, one a processor: llvmpipe-0, ... Those for compute
    // it starts right after them, and they keep the name of the thread that opened the device: this
    // one. Each of the first names itself, on a busy machine only a while after it was started.
    // A second device of the same driver starts none of them.
    constexpr int kTries = 50;
    constexpr std::ptrdiff_t kMostRasterizers = 16; // of Mesa 22.3
    const bool expected = std::ssize(started) > std::min(std::ssize(all), kMostRasterizers);
    auto [last, index] = last_rasterizer(started);
    for (int i = 0; i < kTries && expected && index + 1 < std::ssize(all); ++i) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        std::tie(last, index) = last_rasterizer(started);
    }
    const std::string own_name = thread_name(gettid());
    int next = 0;
    for (const pid_t thread : started) {
        if (thread > last && next <= index && thread_name(thread) == own_name) {
            pin_to(thread, all[static_cast<size_t>(next++)]);
        }
    }
}

} // namespace ecir

#else

namespace ecir {
DriverThreads::DriverThreads() = default;
void DriverThreads::pin() const {}
} // namespace ecir

#endif
