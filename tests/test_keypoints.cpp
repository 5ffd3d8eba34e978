#include <doctest/doctest.h>

#include <string>

#include "layers/keypoints.hpp"
#include "layers/reference/histogram.hpp"
#include "layers/reference/keypoints.hpp"
#include "runtime/error.hpp"
#include "weights/safetensors.hpp"

using namespace ecir;

namespace {

Layout line(size_t width) {
    Layout layout;
    layout.width = static_cast<uint32_t>(width);
    return layout;
}

/// Keypoints by the kernel, dense.
std::vector<float> select(Device& device, const EventView& events, const Exposure& exposure,
                          uint32_t n, bool release, uint32_t width, uint32_t height) {
    const PackedEvents packed = pack_events(events, exposure, width, height);
    const KeypointRule values =
        release ? release_keypoint_rule(packed, n) : paper_keypoint_rule(packed, n);
    Program program(device);
    const Tensor offsets = program.input(line(packed.offset.size()));
    const Tensor times = program.input(line(packed.size() + 1));
    const Tensor ticks = program.input(line(packed.size() + 1));
    const Tensor rule = program.input(line(4));
    const Layout layout{n, height, width, 1, 0, 0};
    const Tensor keypoints = program.output(layout);
    record_keypoints(program, offsets, times, ticks, rule, keypoints, 0, n);
    program.finish();
    program.write(offsets, packed.offset);
    program.write(times, release ? release_times(packed) : packed.time);
    program.write(ticks, packed.tick);
    program.write(rule, std::as_bytes(std::span(&values, 1)));
    program.run();
    return to_dense(layout, program.read(keypoints));
}

/// The keypoints of one pixel whose events have these times, in an exposure of 0 to 12.
std::vector<float> of_times(Device& device, std::initializer_list<int64_t> times, uint32_t n,
                            bool release = false) {
    Events events;
    for (const int64_t t : times) {
        events.push_back(t, 0, 0, 1);
    }
    return select(device, events.view(), {0, 12}, n, release, 1, 1);
}

} // namespace

TEST_SUITE("keypoints") {
    TEST_CASE("pivots move to the nearest event of their own cell") {
        const auto device = Device::open();
        // n = 3: pivots at 0, 6 and 12, borders at 3 and 9.
        CHECK(of_times(*device, {}, 3) == std::vector<float>{-1, 0, 1});
        CHECK(of_times(*device, {2}, 3) == std::vector<float>{-2.0F / 3, 0, 1});
        CHECK(of_times(*device, {1, 2, 5, 11}, 3) ==
              std::vector<float>{-5.0F / 6, -1.0F / 6, 5.0F / 6});
        // An event on a border belongs to the later cell.
        CHECK(of_times(*device, {3}, 3) == std::vector<float>{-1, -0.5F, 1});
        CHECK(of_times(*device, {9}, 3) == std::vector<float>{-1, 0, 0.5F});
        // A tie keeps the earlier event.
        CHECK(of_times(*device, {4, 8}, 3) == std::vector<float>{-1, -1.0F / 3, 1});
        // The exposure's ends.
        CHECK(of_times(*device, {0, 12}, 2) == std::vector<float>{-1, 1});
    }

    TEST_CASE("the release variant runs time from 0 to 1 against pivots from -1 to 1") {
        const auto device = Device::open();
        // First event 2, last 10: times 0, 0.25, 0.75 and 1; pivots -1, 0 and 1.
        CHECK(of_times(*device, {2, 4, 8, 10}, 3, true) == std::vector<float>{-1, 0, 1});
        CHECK(of_times(*device, {2, 6, 10}, 2, true) == std::vector<float>{-1, 1});
        // Only the sensor's first and last event count as such, not the pixel's.
        Events events;
        events.push_back(0, 0, 0, 1);
        events.push_back(2, 1, 0, 1);
        events.push_back(8, 1, 0, 1);
        events.push_back(10, 0, 0, 1);
        CHECK(select(*device, events.view(), {-100, 100}, 3, true, 2, 1) ==
              std::vector<float>{-1, -1, 0, 0.2F, 1, 0.8F});
        // One distinct time has no scale: nothing moves.
        CHECK(of_times(*device, {5, 5}, 3, true) == std::vector<float>{-1, 0, 1});
    }

    TEST_CASE("a million events of one pixel are all looked at") {
        const auto device = Device::open();
        Events events;
        constexpr int64_t kEvents = 1'000'000;
        for (int64_t i = 0; i < kEvents; ++i) { // evenly, but for the last microseconds
            events.push_back(i * 11 / kEvents, 0, 0, 1);
        }
        const auto found = select(*device, events.view(), {0, 12}, 3, false, 1, 1);
        CHECK(found == std::vector<float>{-1, 0, 4.0F / 6});
    }

    TEST_CASE("keypoints ascend, one to a cell") {
        const auto device = Device::open();
        CaseRandom random(3);
        const Exposure exposure{0, longest_exposure_us};
        const Events events = random_events(random, exposure, 16, 16, 20000, 38);
        for (const uint32_t n : {2U, 19U, 20U}) {
            const auto keypoints = select(*device, events.view(), exposure, n, false, 16, 16);
            for (size_t i = 256; i < keypoints.size(); ++i) {
                REQUIRE(keypoints[i] >= keypoints[i - 256]);
            }
        }
    }

    TEST_CASE("unsupported counts and channels are refused") {
        const auto device = Device::open();
        CHECK_THROWS_AS(keypoint_pivots(1), Error);
        CHECK_THROWS_AS(keypoint_pivots(21), Error);
        CHECK_THROWS_AS(paper_keypoint_rule({}, 0), Error);
        Program program(*device);
        const Tensor small = program.input(line(2));
        const Tensor keypoints = program.output({3, 1, 1, 1, 0, 0});
        CHECK_THROWS_AS(record_keypoints(program, small, small, small, small, keypoints, 2, 2),
                        Error);
    }

    TEST_CASE("the training code selects the same keypoints") {
        const auto device = Device::open();
        for (const std::string name : {"paper-173x131", "paper-240x180", "release-173x131"}) {
            CAPTURE(name);
            const SafeTensors file(std::string(ECIR_TEST_DATA) + "/fixtures/ecir-" + name +
                                   ".safetensors");
            Events events;
            for (size_t i = 0; i < file.get("input.t").values.size(); ++i) {
                events.push_back(static_cast<int64_t>(file.get("input.t").values[i]),
                                 static_cast<uint16_t>(file.get("input.x").values[i]),
                                 static_cast<uint16_t>(file.get("input.y").values[i]), 1);
            }
            const auto& image = file.get("input.blurry").shape;
            const auto& kept = file.get("output.keypoints");
            const uint32_t n = kept.shape[0];
            const auto keypoints = select(*device, events.view(), {0, 120000}, n,
                                          name.starts_with("release"), image[1], image[0]);
            constexpr uint32_t stride = 5;
            size_t index = 0;
            for (uint32_t c = 0; c < n; ++c) {
                for (uint32_t y = 0; y < image[0]; y += stride) {
                    for (uint32_t x = 0; x < image[1]; x += stride) {
                        const size_t at = (size_t{c} * image[0] + y) * image[1] + x;
                        REQUIRE(keypoints[at] == kept.values.at(index++));
                    }
                }
            }
            CHECK(index == kept.values.size());
        }
    }
}
