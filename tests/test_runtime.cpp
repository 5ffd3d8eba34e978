#include <doctest/doctest.h>

#include <algorithm>

#include "layers/operations.hpp"
#include "runtime/arena.hpp"
#include "runtime/error.hpp"
#include "runtime/program.hpp"
#include "tests/fixture.hpp"

// The runtime by itself: memory planning, barriers, reflection, devices.
namespace {

using namespace ecir;
using ecir::test::code_of;

/// tap_sum with one tap copies a plane, which is all that these tests need of a kernel.
void add_copy(Program& program, const Tensor& from, const Tensor& to, double flops = 0) {
    struct Push {
        PushLayout from;
        PushLayout added;
        PushLayout to;
        uint32_t height;
        uint32_t width;
        uint32_t kernel;
        uint32_t has_added;
    };
    const Layout& size = to.layout();
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("tap_sum", {}, 3, sizeof(Push));
    dispatch.arguments = {read(from), read(from), write(to)};
    dispatch.set_push(
        Push{PushLayout(from), PushLayout(from), PushLayout(to), size.height, size.width, 1, 0});
    dispatch.groups = {(size.width + 63) / 64, size.height, 1};
    dispatch.flops = flops;
    dispatch.label = "copy";
    program.add(std::move(dispatch));
}

} // namespace

TEST_SUITE("runtime") {
    TEST_CASE("blocks that live at the same time never overlap, others share memory") {
        CaseRandom random(7);
        for (int round = 0; round < 50; ++round) {
            std::vector<Lifetime> blocks;
            uint64_t sum = 0;
            for (int i = 0; i < 40; ++i) {
                const uint32_t first = random.integer(0, 60);
                blocks.push_back({random.integer(1, 5000), first, first + random.integer(0, 9)});
                sum += blocks.back().bytes;
            }
            const ArenaPlan plan = plan_arena(blocks, 256);
            for (size_t a = 0; a < blocks.size(); ++a) {
                CHECK(plan.offsets[a] % 256 == 0);
                CHECK(plan.offsets[a] + blocks[a].bytes <= plan.bytes);
                for (size_t b = 0; b < a; ++b) {
                    const bool together =
                        blocks[a].first <= blocks[b].last && blocks[b].first <= blocks[a].last;
                    const bool apart = plan.offsets[a] + blocks[a].bytes <= plan.offsets[b] ||
                                       plan.offsets[b] + blocks[b].bytes <= plan.offsets[a];
                    CHECK((!together || apart));
                }
            }
            CHECK(plan.bytes < sum);
        }
    }

    TEST_CASE("a chain of temporaries needs two of them, and a barrier a step") {
        const auto device = Device::open();
        Program program(*device);
        const Layout plane{1, 256, 256};
        const Tensor in = program.input(plane);
        Tensor last = in;
        constexpr int kSteps = 10;
        for (int i = 0; i < kSteps; ++i) {
            const Tensor next = i + 1 < kSteps ? program.temporary(plane) : program.output(plane);
            add_copy(program, last, next);
            last = next;
        }
        program.finish();
        const std::vector<float> values = CaseRandom(1).values(256 * 256, -1, 1);
        program.write(in, values);
        program.run();
        CHECK(std::ranges::equal(program.read(last), values));
        CHECK(program.barriers() == kSteps);
        CHECK(program.arena_bytes() < 3 * plane.elements() * 4);
    }

    TEST_CASE("more workgroups than the device launches are refused by the kernel's name") {
        const auto device = Device::open();
        const uint64_t most = device->info().max_groups[1];
        if (most >= 1U << 24) {
            return; // no image is so high
        }
        Program program(*device);
        const Layout high{1, static_cast<uint32_t>(most) + 1, 1};
        const Tensor from = program.input(high);
        const Tensor to = program.output(high);
        CHECK_THROWS_WITH_AS(add_copy(program, from, to), doctest::Contains("tap_sum"), Error);
        CHECK(code_of([&] { add_copy(program, from, to); }) == ExitCode::resources);
    }

    TEST_CASE("steps that touch different bytes need no barrier between them") {
        const auto device = Device::open();
        Program program(*device);
        const Layout planes{8, 16, 64};
        const Tensor in = program.input(planes);
        const Tensor out = program.output(planes);
        for (uint32_t c = 0; c < 8; ++c) {
            add_copy(program, in.channels(c, 1), out.channels(c, 1));
        }
        program.finish();
        const std::vector<float> values = CaseRandom(2).values(8 * 16 * 64, -1, 1);
        program.write(in, values);
        program.run();
        CHECK(std::ranges::equal(program.read(out), values));
        CHECK(program.barriers() == 1); // the upload before the first
    }

    TEST_CASE("views of channels at offsets that no device binds") {
        const auto device = Device::open();
        Program program(*device);
        const Layout odd{5, 3, 7}; // 84 bytes a plane
        const Tensor in = program.input(odd);
        const Tensor out = program.output(odd);
        for (uint32_t c = 0; c < 5; ++c) {
            add_copy(program, in.channels(4 - c, 1), out.channels(c, 1));
        }
        program.finish();
        const std::vector<float> values = CaseRandom(3).values(5 * 21, -1, 1);
        program.write(in, values);
        program.run();
        for (size_t c = 0; c < 5; ++c) {
            CHECK(std::ranges::equal(program.read(out).subspan(c * 21, 21),
                                     std::span(values).subspan((4 - c) * 21, 21)));
        }
    }

    TEST_CASE("inputs keep their content from run to run") {
        const auto device = Device::open();
        Program program(*device);
        const Layout plane{1, 4, 4};
        const Tensor in = program.input(plane);
        const Tensor between = program.temporary(plane);
        const Tensor out = program.output(plane);
        add_copy(program, in, between);
        add_copy(program, between, out);
        program.finish();
        const std::vector<float> values = CaseRandom(4).values(16, -1, 1);
        program.write(in, values);
        for (int run = 0; run < 3; ++run) {
            program.run();
            CHECK(std::ranges::equal(program.read(out), values));
        }
    }

    TEST_CASE("work side by side shares its barriers, however it was added") {
        const auto device = Device::open();
        constexpr int kChains = 5;
        constexpr int kLinks = 4;
        const Layout plane{1, 8, 8};
        const auto run = [&](bool apart) {
            Program program(*device);
            const Tensor in = program.input(plane);
            std::vector<Tensor> between;
            for (int i = 0; i + 1 < kLinks; ++i) {
                between.push_back(program.temporary(plane));
            }
            std::vector<Tensor> out;
            for (int chain = 0; chain < kChains; ++chain) {
                Tensor last = in;
                for (int link = 0; link < kLinks; ++link) {
                    Tensor next;
                    if (link + 1 == kLinks) {
                        next = out.emplace_back(program.output(plane));
                    } else {
                        next = apart ? program.temporary(plane) : between.at(link);
                    }
                    add_copy(program, last, next, chain * kLinks + link);
                    last = next;
                }
            }
            program.finish();
            const auto values = CaseRandom(8).values(64, -1, 1);
            program.write(in, values);
            program.run();
            for (const Tensor& each : out) {
                CHECK(std::ranges::equal(program.read(each), values));
            }
            const auto times = program.profile();
            for (size_t i = 0; i < times.size(); ++i) {
                CHECK(times[i].flops == static_cast<double>(i)); // as they were added
            }
            return program.barriers();
        };
        CHECK(run(true) == kLinks); // the first after the upload
        // With common tensors a chain begins where the one before has left the first of them.
        CHECK(run(false) == 2 * (kChains - 1) + kLinks);
    }

    TEST_CASE("parts of a tensor are waited for apart, and zeros come before what needs them") {
        const auto device = Device::open();
        Program program(*device);
        const Layout plane{1, 8, 8};
        const Tensor in = program.input(plane);
        const Tensor out = program.output({3, 8, 8});
        program.clear(out);
        const Tensor both = program.cleared({2, 8, 8});
        add_copy(program, in, both.channels(0, 1));
        add_copy(program, in, out.channels(0, 1)); // need not wait for the one before
        add_copy(program, both.channels(0, 1), out.channels(1, 1));
        add_copy(program, both.channels(1, 1), out.channels(2, 1));
        program.finish();
        // After the upload, the zeros, and the copies into them.
        CHECK(program.barriers() == 3);
        const auto values = CaseRandom(3).values(64, 1, 2);
        for (int run = 0; run < 2; ++run) {
            program.write(in, values);
            program.run();
            const auto made = program.read(out);
            CHECK(std::ranges::equal(made.first(64), values));
            CHECK(std::ranges::equal(made.subspan(64, 64), values));
            CHECK(std::ranges::count(made.subspan(128), 0.0F) == 64);
        }
    }

    TEST_CASE("two runs under way keep their inputs and outputs apart") {
        const auto runs_apart = [](Device& opened) {
            Program program(opened);
            const Layout plane{1, 64, 64};
            const Tensor in = program.input(plane);
            Tensor last = in;
            for (int i = 0; i < 4; ++i) {
                const Tensor next = i < 3 ? program.temporary(plane) : program.output(plane);
                add_copy(program, last, next);
                last = next;
            }
            program.finish();
            CaseRandom random(6);
            std::vector<std::vector<float>> values;
            for (size_t run = 0; run < 7; ++run) {
                values.push_back(random.values(64 * 64, -1, 1));
                REQUIRE(program.reserve());
                program.write(in, values[run]);
                program.submit();
                if (run > 0) {
                    CHECK(!program.reserve());
                    CHECK_THROWS_AS(program.write(in, values[run]), Error);
                    CHECK_THROWS_AS(program.submit(), Error);
                    program.wait();
                    CHECK(std::ranges::equal(program.read(last), values[run - 1]));
                }
            }
            program.wait();
            CHECK(std::ranges::equal(program.read(last), values[6]));
            CHECK_THROWS_AS(program.wait(), Error);
            program.write(in, values[0]);
            program.submit(); // what nobody waits for ends before the program does
        };
        runs_apart(*Device::open());
        ::setenv("ECIR_QUEUES", "2", 1); // with an arena each, where this device has one queue too
        const auto device = Device::open();
        CHECK(device->queues() == 2);
        runs_apart(*device);
        ::setenv("ECIR_QUEUES", "many", 1);
        CHECK_THROWS_WITH_AS(Device::open(), doctest::Contains("ECIR_QUEUES is many"), Error);
        ::unsetenv("ECIR_QUEUES");
    }

    TEST_CASE("what depends on a flag runs where it is set, from run to run") {
        const auto device = Device::open();
        Program program(*device);
        constexpr uint32_t kShapes = 11; // more than one launch kernel prepares
        const Tensor flag = program.input({3, 1, 1});
        std::vector<Tensor> from;
        std::vector<Tensor> to;
        for (uint32_t i = 0; i < kShapes; ++i) {
            from.push_back(program.input({1, i + 2, 64}));
            to.push_back(program.output({1, i + 2, 64}));
            program.clear(to.back());
        }
        program.when(flag.channels(1, 1), [&] {
            for (uint32_t i = 0; i < kShapes; ++i) {
                add_copy(program, from[i], to[i]);
            }
            add_copy(program, to[3], to[3]); // a shape for the second time
        });
        program.finish();
        const std::vector<float> values = CaseRandom(9).values(64 * (kShapes + 1), 1, 2);
        for (const float set : {1.0F, 0.0F, 1.0F}) {
            program.write(flag, std::vector<float>{7, set, 8});
            for (uint32_t i = 0; i < kShapes; ++i) {
                program.write(from[i], std::span(values).first(size_t{64} * (i + 2)));
            }
            program.run();
            for (uint32_t i = 0; i < kShapes; ++i) {
                const auto made = program.read(to[i]);
                CAPTURE(i);
                CHECK(std::ranges::equal(made, std::span(values).first(made.size()), {}, {},
                                         [&](float value) { return set * value; }));
            }
        }
    }

    TEST_CASE("a clear and a second condition inside of one are refused") {
        const auto device = Device::open();
        const auto refused = [&](const auto& inside) {
            Program program(*device);
            const Tensor flag = program.input({1, 1, 1});
            return code_of([&] { program.when(flag, [&] { inside(program, flag); }); });
        };
        CHECK(refused([](Program& program, const Tensor& flag) { program.clear(flag); }) ==
              ExitCode::device);
        CHECK(refused([](Program& program, const Tensor& flag) { program.when(flag, [] {}); }) ==
              ExitCode::device);
        CHECK(refused([](Program&, const Tensor&) {}) == ExitCode::ok);
    }

    TEST_CASE("long work goes in several submissions and still adds up") {
        const auto device = Device::open();
        Program program(*device);
        const Layout plane{1, 8, 8};
        const Tensor in = program.input(plane);
        Tensor last = in;
        for (int i = 0; i < 6; ++i) {
            const Tensor next = i < 5 ? program.temporary(plane) : program.output(plane);
            add_copy(program, last, next, 1e12); // as if each were long
            last = next;
        }
        program.finish();
        CHECK(program.submissions() == 6);
        const std::vector<float> values = CaseRandom(5).values(64, -1, 1);
        program.write(in, values);
        program.run();
        CHECK(std::ranges::equal(program.read(last), values));
        const auto times = program.profile();
        CHECK(times.size() == 6);
        CHECK(std::ranges::all_of(times, [](const DispatchTime& t) { return t.ms >= 0; }));
    }

    TEST_CASE("more memory than the device has is refused with both figures before anything runs") {
        const auto device = Device::open();
        const uint64_t heap = device->info().heap_bytes;
        const auto check = [&](const auto& action) {
            try {
                action();
                FAIL("no error");
            } catch (const Error& error) {
                CHECK(error.code() == ExitCode::resources);
                CHECK(std::string(error.what()).find(mebibytes(heap)) != std::string::npos);
            }
        };
        Program program(*device);
        check([&] { program.output({1, static_cast<uint32_t>(heap / (4 * 4096) + 1), 4096}); });
        const Layout half{1, static_cast<uint32_t>(heap / (4 * 4096) / 2 + 1), 4096};
        program.output(half);
        program.output(half);
        check([&] { program.finish(); });
    }

    TEST_CASE("a kernel is checked against its shader when it is made") {
        const auto device = Device::open();
        CHECK(code_of([&] { device->kernel("tap_sum", {}, 2, 64); }) == ExitCode::device);
        CHECK(code_of([&] { device->kernel("tap_sum", {}, 3, 60); }) == ExitCode::device);
        CHECK(code_of([&] { device->kernel("no_such_shader", {}, 2, 48); }) == ExitCode::device);
        CHECK(code_of([&] { device->kernel("tap_sum", {}, 3, 64); }) == ExitCode::ok);
    }

    TEST_CASE("devices are chosen by index and by a part of the name") {
        const auto devices = Device::list();
        REQUIRE(!devices.empty());
        CHECK(std::ranges::count_if(devices, &DeviceInfo::is_default) == 1);
        for (const DeviceInfo& info : devices) {
            CHECK(Device::open(std::to_string(info.index))->info().index == info.index);
        }
        CHECK(Device::open(devices.front().name.substr(0, 4))->info().index == 0);
        CHECK(code_of([] { Device::open("no such device"); }) == ExitCode::device);
        CHECK(code_of([] { Device::open("99"); }) == ExitCode::device);
    }
}
