#include <doctest/doctest.h>

#if defined(__linux__)

#include <sched.h>

#include <cstdlib>
#include <filesystem>
#include <set>
#include <string>

#include "runtime/device.hpp"

using namespace ecir;

namespace {

/// The processors that have a thread of this process to themselves.
std::multiset<int> pinned_to() {
    std::multiset<int> found;
    for (const auto& entry : std::filesystem::directory_iterator("/proc/self/task")) {
        cpu_set_t set;
        const pid_t thread = std::stoi(entry.path().filename().string());
        if (sched_getaffinity(thread, sizeof(set), &set) == 0 && CPU_COUNT(&set) == 1) {
            int processor = 0;
            while (!CPU_ISSET(processor, &set)) {
                ++processor;
            }
            found.insert(processor);
        }
    }
    return found;
}

} // namespace

TEST_SUITE("runtime") {
    TEST_CASE("lavapipe's threads get a processor each, one for every processor") {
        cpu_set_t all;
        REQUIRE(sched_getaffinity(0, sizeof(all), &all) == 0);
        constexpr int kMostThreads = 16; // that lavapipe starts
        const auto device = Device::open();
        if (device->info().name.find("llvmpipe") == std::string::npos ||
            std::getenv("LP_NUM_THREADS") != nullptr || CPU_COUNT(&all) < 2 ||
            CPU_COUNT(&all) > kMostThreads) {
            return;
        }
        const auto found = pinned_to();
        for (int i = 0; i < CPU_SETSIZE; ++i) {
            CHECK(found.count(i) >= (CPU_ISSET(i, &all) ? 1U : 0U));
            CHECK((CPU_ISSET(i, &all) || found.count(i) == 0));
        }
        cpu_set_t own;
        REQUIRE(sched_getaffinity(0, sizeof(own), &own) == 0);
        CHECK(CPU_EQUAL(&own, &all)); // the caller's stays
    }
}

#endif
