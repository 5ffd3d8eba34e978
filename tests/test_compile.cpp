#include <doctest/doctest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <future>
#include <thread>

#include "runtime/compile_ahead.hpp"
#include "runtime/compile_queue.hpp"
#include "runtime/device.hpp"
#include "runtime/error.hpp"
#include "runtime/kernel.hpp"

using namespace ecir;

TEST_SUITE("runtime") {
    TEST_CASE("pipelines are made once each, and failing is told to who asks for that one") {
        std::atomic<int> made = 0;
        CompileQueue queue;
        std::array<CompileQueue::Pipeline, 40> pipelines;
        for (size_t i = 0; i < pipelines.size(); ++i) {
            pipelines.at(i) = queue.add([&made, i]() -> Handle<VkPipeline> {
                ++made;
                if (i == 7) {
                    throw Error(ExitCode::device, "does not compile");
                }
                return {};
            });
        }
        for (size_t i = 0; i < pipelines.size(); ++i) {
            if (i == 7) {
                CHECK_THROWS_AS((void)pipelines.at(i).get(), Error);
            } else {
                CHECK_NOTHROW((void)pipelines.at(i).get());
            }
        }
        CHECK(made == 40);
    }

    TEST_CASE("a queue that ends drops what nobody has begun") {
        constexpr int kMostThreads = 16;
        std::atomic<int> made = 0;
        std::promise<void> open;
        std::atomic<bool> leaving = false;
        CompileQueue::Pipeline last;
        std::thread opener;
        {
            CompileQueue queue;
            const auto gate = open.get_future().share();
            for (int i = 0; i < 2 * kMostThreads; ++i) {
                last = queue.add([&made, gate]() -> Handle<VkPipeline> {
                    gate.wait();
                    ++made;
                    return {};
                });
            }
            opener = std::thread([&open, &leaving] {
                leaving.wait(false);
                std::this_thread::sleep_for(
                    std::chrono::milliseconds(200)); // the queue's end begins
                open.set_value();
            });
            leaving = true;
            leaving.notify_one();
        }
        opener.join();
        CHECK(made <= kMostThreads);
        CHECK_THROWS_AS((void)last.get(), std::future_error);
    }

    // Cooperative matrices are types that SPIRV-Cross need not know.
    TEST_CASE("shaders with cooperative matrices tell what they bind") {
        for (const char* name : {"conv_matrix_khr", "conv_matrix_nv"}) {
            if (is_embedded(name)) {
                const Reflection found = reflect(name, embedded_shader(name));
                CHECK(found.bindings.size() == 6);
                CHECK(found.push_bytes == 60);
                CHECK(found.matrices);
            }
        }
        CHECK(is_embedded("conv_tile"));
        CHECK_FALSE(reflect("conv_tile", embedded_shader("conv_tile")).matrices);
        CHECK(!is_embedded("conv_tiles"));
    }

    // The validation layer watches the dispatches without workgroups.
    TEST_CASE("kernels with storage and uniform buffers are compiled ahead on another device") {
        const auto device = Device::open();
        if (!device->info().buffer_address) {
            return;
        }
        const std::array<uint32_t, 2> sum{2, 4};
        const std::array<uint32_t, 9> point{device->info().subgroup_size, 4, 1, 1, 1, 1, 8, 1, 0};
        const Kernel& elementwise = device->kernel("elementwise", sum, 3, 56);
        const Kernel& conv = device->kernel("conv_lane", point, 4, 88);
        { const CompileAhead ahead(*device, {&elementwise, &conv}); }
        CHECK(elementwise.pipeline() != VK_NULL_HANDLE);
        CHECK(conv.pipeline() != VK_NULL_HANDLE);
    }
}
