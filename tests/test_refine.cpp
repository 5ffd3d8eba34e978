#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "layers/elementwise.hpp"
#include "layers/reference/refine.hpp"
#include "layers/refine.hpp"
#include "runtime/error.hpp"

using namespace ecir;

namespace {

/// The update by the kernel, of d frames; values dense.
std::vector<float> update(Device& device, const reference::ImageSize& size, uint32_t d,
                          const std::vector<float>& initial, const std::vector<float>& frames,
                          const std::vector<float>& residuals, const AlphaWeights& alpha,
                          uint32_t pitch = 0, float largest_step = INFINITY) {
    Program program(device);
    const Layout layout{d, size.height, size.width, 1, 1, pitch};
    Layout state_layout = refine_state_layout(d, size.height, size.width);
    state_layout.pitch = pitch;
    const Tensor initial_input = program.input(layout);
    const Tensor state = program.input(state_layout);
    const Tensor updated = program.output(layout);
    const Tensor largest = program.temporary({1, 1, 1});
    program.clear(largest);
    record_refine_update(program, initial_input, state, alpha, updated, largest, largest_step);
    program.finish();
    program.write(initial_input, from_dense(layout, initial));
    program.write(state,
                  from_dense(state_layout, reference::update_state(frames, residuals, size)));
    program.run();
    return to_dense(layout, program.read(updated));
}

} // namespace

TEST_SUITE("refine") {
    TEST_CASE("state: frames, gradients, events and the residual before, in this order") {
        const auto device = Device::open();
        Program program(*device);
        const Layout two{3, 2, 2, 1, 1};
        const Layout pair{4, 2, 2};
        const Layout result = refine_state_layout(3, 2, 2);
        const Tensor frames = program.input(two);
        const Tensor counts = program.input(pair);
        const Tensor one = program.input({1, 2, 2});
        const Tensor none = program.input({1, 2, 2});
        const Tensor state = program.output(result);
        program.clear(state);
        record_refine_state(program, frames, &counts, state);
        record_add(program, one, none, refine_residual(state, 0));
        program.finish();
        program.write(frames,
                      from_dense(two, std::vector<float>{9, 9, 9, 9, 1, 2, 4, 8, 5, 5, 6, 6}));
        program.write(counts, from_dense(pair, std::vector<float>{9, 9, 9, 9, 9, 9, 9, 9, 1, 0, 0,
                                                                  2, 0, 3, 0, 0}));
        program.write(one, std::vector<float>{7, 8, 9, 10});
        program.write(none, std::vector<float>(4));
        program.run();
        const Layout input = refine_network_input(state, 1).layout();
        const auto values = program.read(state).subspan(
            refine_network_input(state, 1).byte_offset() / sizeof(float));
        CHECK(to_dense(input, values) == std::vector<float>{1, 2,  4,  8,  // frame 1
                                                            0, -1, 0,  -4, // left less pixel
                                                            0, 0,  -3, -6, // upper less pixel
                                                            1, 0,  0,  2,  // positive events
                                                            0, 3,  0,  0,  // of interval 1
                                                            7, 8,  9,  10, // residual 0
                                                            5, 5,  6,  6,  // frame 2
                                                            0, 0,  0,  0,  //
                                                            0, 0,  -1, -1});
    }

    TEST_CASE("update: by hand, at the first, an inner and the last frame") {
        const auto device = Device::open();
        AlphaWeights alpha{};
        alpha[9] = 5; // alpha = 0.5 everywhere
        const reference::ImageSize pixel{1, 1};
        // directions: 2 (1 - 0) + 2 (1 + 10 - 2), 2 (2 - 0) - 2 (1 + 10 - 2) + 2 (2 + 20 - 4),
        //             2 (4 - 0) - 2 (2 + 20 - 4)
        const auto moved = update(*device, pixel, 3, {0, 0, 0}, {1, 2, 4}, {10, 20}, alpha);
        CHECK(moved[0] == doctest::Approx(1 - 0.5 * 20));
        CHECK(moved[1] == doctest::Approx(2 - 0.5 * 22));
        CHECK(moved[2] == doctest::Approx(4 - 0.5 * -28));
        CHECK(update(*device, pixel, 1, {0.5F}, {1}, {}, alpha)[0] == doctest::Approx(0.5));
    }

    TEST_CASE("update: alpha is never negative, and frames that fit everything stay") {
        const auto device = Device::open();
        CaseRandom random(4);
        const reference::ImageSize size{4, 5};
        const auto frames = random.values(60, 0, 1);
        const auto initial = random.values(60, 0, 1);
        const auto residuals = random.values(40, -1, 1);
        AlphaWeights alpha{};
        alpha.fill(-1);
        CHECK(update(*device, size, 3, initial, frames, residuals, alpha) == frames);
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
        CHECK(update(*device, size, 3, whole, whole, differences, alpha) == whole);
    }

    TEST_CASE("update: below the largest step equation 8 never grows, above it does") {
        const auto device = Device::open();
        const reference::ImageSize size{8, 16};
        for (const uint32_t d : {1U, 2U, 3U, 14U}) {
            CAPTURE(d);
            const size_t pixels = size.pixels();
            CaseRandom random(d);
            const std::vector<float> initial = random.values(d * pixels, 0, 1);
            const std::vector<float> residuals = random.values((d - 1) * pixels, -1, 1);
            const auto objective = [&](const std::vector<float>& frames, size_t pixel) {
                double sum = 0;
                for (size_t i = 0; i < d; ++i) {
                    const size_t at = i * pixels + pixel;
                    sum += std::pow(double{frames[at]} - initial[at], 2);
                    sum +=
                        i + 1 < d
                            ? std::pow(double{frames[at]} + residuals[at] - frames[at + pixels], 2)
                            : 0;
                }
                return sum;
            };
            // Each step after the last: frames settle in the direction that grows first.
            const auto largest_growth = [&](float largest_step) {
                AlphaWeights alpha{};
                alpha[9] = 100; // far more than any bound
                std::vector<float> frames = random.values(d * pixels, -1, 2);
                double growth = 0;
                for (int step = 0; step < 40; ++step) {
                    const auto next = update(*device, size, d, initial, frames, residuals, alpha, 0,
                                             largest_step);
                    for (size_t p = 0; p < pixels; ++p) {
                        growth = std::max(growth, objective(next, p) - objective(frames, p));
                    }
                    frames = next;
                }
                return growth;
            };
            const float largest = largest_refine_step(d);
            CHECK(largest > 0.2F);
            CHECK(largest_growth(largest) < 1e-4);
            CHECK(largest_growth(1.05F * largest) > 1e-2);
        }
    }

    TEST_CASE("what has settled, no longer falls, or is no number ends the refinement") {
        const auto device = Device::open();
        const auto goes_on = [&](float largest, float least, std::optional<float> before) {
            Program program(*device);
            const Tensor seen = program.input({3, 1, 1});
            const Tensor moving = program.output({2, 1, 1});
            program.clear(moving);
            record_refine_settled(program, seen.channels(1, 1), least,
                                  before ? std::optional(seen.channels(2, 1)) : std::nullopt,
                                  moving.channels(1, 1));
            program.finish();
            program.write(seen, std::vector<float>{0, largest, before.value_or(0)});
            program.run();
            CHECK(program.read(moving)[0] == 0);
            return program.read(moving)[1] == 1;
        };
        CHECK(goes_on(0.2F, 0.1F, {}));
        CHECK(goes_on(0.1F, 0.1F, {}));
        CHECK_FALSE(goes_on(0.09F, 0.1F, {}));
        CHECK_FALSE(goes_on(0, 0.1F, {}));
        CHECK(goes_on(0.2F, 0.1F, 0.3F));
        CHECK_FALSE(goes_on(0.2F, 0.1F, 0.2F));
        CHECK_FALSE(goes_on(0.09F, 0.1F, 0.3F));
        CHECK_FALSE(goes_on(NAN, 0.1F, {}));
    }

    TEST_CASE("update: frames larger together than the device can bind") {
        const auto device = Device::open();
        const uint64_t range = device->info().max_storage_range;
        if (range > uint64_t{256} << 20) {
            return; // nothing of a sensible size exceeds it
        }
        // Rows far apart: three frames' state to a view.
        const reference::ImageSize size{2, 3};
        CaseRandom random(8);
        const auto frames = random.values(5 * size.pixels(), 0, 1);
        const auto initial = random.values(5 * size.pixels(), 0, 1);
        const auto residuals = random.values(4 * size.pixels(), -1, 1);
        AlphaWeights alpha{};
        alpha.fill(0.2F);
        const auto expected = reference::refine_update(initial, frames, residuals, alpha, size);
        const auto moved = update(*device, size, 5, initial, frames, residuals, alpha,
                                  static_cast<uint32_t>(range / 4 / 4 / 19));
        REQUIRE(moved.size() == expected.size());
        for (size_t i = 0; i < moved.size(); ++i) {
            CHECK(moved[i] == doctest::Approx(expected[i]).epsilon(1e-5));
        }
    }

    TEST_CASE("shapes that do not match are refused") {
        const auto device = Device::open();
        Program program(*device);
        const Tensor frames = program.input({3, 4, 5, 1, 1, 0});
        const Tensor counts = program.input({4, 4, 5});
        const Tensor narrow = program.input({3, 4, 4, 1, 1, 0});
        const Tensor blocked = program.input({3, 4, 5, 8, 1, 0});
        const Tensor bare = program.input({3, 4, 5});
        const Tensor state = program.input(refine_state_layout(3, 4, 5));
        const Tensor small = program.input(refine_state_layout(2, 4, 5));
        CHECK_THROWS_AS(record_refine_state(program, frames, &counts, small), Error);
        CHECK_THROWS_AS(record_refine_state(program, narrow, &counts, state), Error);
        CHECK_THROWS_AS(record_refine_state(program, frames, &frames, state), Error);
        CHECK_THROWS_AS(record_refine_update(program, frames, small, {}, frames, bare), Error);
        CHECK_THROWS_AS(record_refine_update(program, blocked, state, {}, frames, bare), Error);
        CHECK_THROWS_AS(record_refine_update(program, frames, state, {}, bare, bare), Error);
    }
}
