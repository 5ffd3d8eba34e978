#include <doctest/doctest.h>

#include <algorithm>

#include "layers/reference/refine.hpp"
#include "layers/refine.hpp"
#include "runtime/error.hpp"

using namespace ecir;

namespace {

/// The update by the kernel; all tensors in one layout, but for another row pitch of the frames;
/// values dense.
std::vector<float> update(Device& device, const Layout& layout, const std::vector<float>& initial,
                          const std::vector<float>& frames, const std::vector<float>& residuals,
                          const AlphaWeights& alpha, uint32_t frame_pitch = 0) {
    Program program(device);
    Layout frame_layout = layout;
    frame_layout.pitch = frame_pitch;
    Layout between = layout;
    between.channels = std::max(layout.channels, 2U) - 1;
    const Tensor initial_input = program.input(layout);
    const Tensor frame_input = program.input(frame_layout);
    const Tensor residual_input = program.input(between);
    const Tensor updated = program.output(layout);
    record_refine_update(program, initial_input, frame_input,
                         layout.channels > 1 ? residual_input : Tensor(), alpha, updated);
    program.finish();
    program.write(initial_input, from_dense(layout, initial));
    program.write(frame_input, from_dense(frame_layout, frames));
    if (layout.channels > 1) {
        program.write(residual_input, from_dense(between, residuals));
    }
    program.run();
    return to_dense(layout, program.read(updated));
}

} // namespace

TEST_SUITE("refine") {
    TEST_CASE("network input: frames, gradients, events and the residual before, in this order") {
        const auto device = Device::open();
        Program program(*device);
        const Layout two{3, 2, 2, 1, 1, 0};
        const Layout pair{4, 2, 2, 1, 0, 0};
        const Layout one{2, 2, 2, 1, 1, 0};
        const Layout result{9, 2, 2, 8, 1, 0};
        const Tensor frames = program.input(two);
        const Tensor counts = program.input(pair);
        const Tensor residuals = program.input(one);
        const Tensor input = program.output(result);
        program.clear(input);
        record_refine_input(program, frames, counts, residuals, 1, input);
        program.finish();
        program.write(frames,
                      from_dense(two, std::vector<float>{9, 9, 9, 9, 1, 2, 4, 8, 5, 5, 6, 6}));
        program.write(counts, from_dense(pair, std::vector<float>{9, 9, 9, 9, 9, 9, 9, 9, 1, 0, 0,
                                                                  2, 0, 3, 0, 0}));
        program.write(residuals, from_dense(one, std::vector<float>{7, 8, 9, 10, 9, 9, 9, 9}));
        program.run();
        CHECK(to_dense(result, program.read(input)) ==
              std::vector<float>{1, 2,  4,  8,    // frame 1
                                 5, 5,  6,  6,    // frame 2
                                 0, -1, 0,  -4,   // left neighbour less pixel
                                 0, 0,  -3, -6,   // upper neighbour less pixel
                                 0, 0,  0,  0,    //
                                 0, 0,  -1, -1,   //
                                 1, 0,  0,  2,    // positive events of interval 1
                                 0, 3,  0,  0,    //
                                 7, 8,  9,  10}); // residual 0
    }

    TEST_CASE("network input: channels that fill up the last block are left alone") {
        const auto device = Device::open();
        for (const uint32_t interval : {0U, 1U}) {
            CAPTURE(interval);
            Program program(*device);
            const Layout many{16, 3, 5, 16, 1, 0};
            const Tensor frames = program.input({3, 3, 5, 1, 1, 0});
            const Tensor counts = program.input({4, 3, 5, 1, 0, 0});
            const Tensor input = program.output(many);
            program.clear(input);
            const uint32_t channels = residual_channels(interval);
            record_refine_input(program, frames, counts, frames, interval,
                                input.channels(0, channels));
            program.finish();
            program.write(frames, std::vector<float>(size_t{3} * 5 * 7, 1));
            program.run();
            const auto values = to_dense(many, program.read(input));
            CHECK(values.at(8 * 15) ==
                  (interval == 0 ? 0.0F : 1.0F)); // a frame of ones as residual
            CHECK(std::all_of(values.begin() + 9 * 15, values.end(),
                              [](float value) { return value == 0; }));
        }
    }

    TEST_CASE("update: by hand, at the first, an inner and the last frame") {
        const auto device = Device::open();
        AlphaWeights alpha{};
        alpha[9] = 5; // alpha = 0.5 everywhere
        const Layout pixel{3, 1, 1, 1, 1, 0};
        // directions: 2 (1 - 0) + 2 (1 + 10 - 2), 2 (2 - 0) - 2 (1 + 10 - 2) + 2 (2 + 20 - 4),
        //             2 (4 - 0) - 2 (2 + 20 - 4)
        const auto moved = update(*device, pixel, {0, 0, 0}, {1, 2, 4}, {10, 20}, alpha);
        CHECK(moved[0] == doctest::Approx(1 - 0.5 * 20));
        CHECK(moved[1] == doctest::Approx(2 - 0.5 * 22));
        CHECK(moved[2] == doctest::Approx(4 - 0.5 * -28));
        const Layout single{1, 1, 1, 1, 0, 0};
        CHECK(update(*device, single, {0.5F}, {1}, {}, alpha)[0] == doctest::Approx(0.5));
    }

    TEST_CASE("update: alpha is never negative, and frames that fit everything stay") {
        const auto device = Device::open();
        CaseRandom random(4);
        const Layout layout{3, 4, 5, 1, 1, 0};
        const auto frames = random.values(60, 0, 1);
        const auto initial = random.values(60, 0, 1);
        const auto residuals = random.values(40, -1, 1);
        AlphaWeights alpha{};
        alpha.fill(-1);
        CHECK(update(*device, layout, initial, frames, residuals, alpha) == frames);
        // Whole numbers: residuals that are exactly the frames' differences.
        std::vector<float> whole(60);
        std::vector<float> differences(40);
        for (size_t i = 0; i < 60; ++i) {
            whole[i] = static_cast<float>(random.integer(0, 255));
        }
        for (size_t i = 0; i < 40; ++i) {
            differences[i] = whole[i + 20] - whole[i];
        }
        alpha.fill(1);
        CHECK(update(*device, layout, whole, whole, differences, alpha) == whole);
    }

    TEST_CASE("update: frames larger together than the device can bind") {
        const auto device = Device::open();
        const uint64_t range = device->info().max_storage_range;
        if (range > uint64_t{256} << 20) {
            return; // nothing of a sensible size exceeds it
        }
        // Rows far apart: four frames to a view.
        const reference::ImageSize size{2, 3};
        const Layout layout{5, 2, 3, 1, 0, 0};
        CaseRandom random(8);
        const auto frames = random.values(5 * size.pixels(), 0, 1);
        const auto initial = random.values(5 * size.pixels(), 0, 1);
        const auto residuals = random.values(4 * size.pixels(), -1, 1);
        AlphaWeights alpha{};
        alpha.fill(0.2F);
        const auto expected = reference::refine_update(initial, frames, residuals, alpha, size);
        const auto moved = update(*device, layout, initial, frames, residuals, alpha,
                                  static_cast<uint32_t>(range / 4 / 2 / 5));
        REQUIRE(moved.size() == expected.size());
        for (size_t i = 0; i < moved.size(); ++i) {
            CHECK(moved[i] == doctest::Approx(expected[i]).epsilon(1e-5));
        }
    }

    TEST_CASE("shapes that do not match are refused") {
        const auto device = Device::open();
        Program program(*device);
        const Tensor frames = program.input({3, 4, 5, 1, 1, 0});
        const Tensor counts = program.input({4, 4, 5, 1, 0, 0});
        const Tensor narrow = program.input({3, 4, 4, 1, 1, 0});
        const Tensor blocked = program.input({3, 4, 5, 8, 1, 0});
        const Tensor input = program.output({9, 4, 5, 8, 1, 0});
        CHECK_THROWS_AS(record_refine_input(program, frames, counts, frames, 2, input), Error);
        CHECK_THROWS_AS(record_refine_input(program, narrow, counts, frames, 0, input), Error);
        CHECK_THROWS_AS(record_refine_input(program, frames, counts, narrow, 1, input), Error);
        CHECK_THROWS_AS(record_refine_update(program, frames, frames, narrow, {}, frames), Error);
        CHECK_THROWS_AS(record_refine_update(program, frames, blocked, frames, {}, frames), Error);
        CHECK_THROWS_AS(record_refine_update(program, frames, frames, Tensor(), {}, frames), Error);
    }
}
