#include <doctest/doctest.h>

#include <algorithm>
#include <string>

#include "layers/histogram.hpp"
#include "layers/keypoints.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/reference/histogram.hpp"
#include "weights/safetensors.hpp"

using namespace ecir;

namespace {

constexpr Exposure exposure{0, 120000};

Layout line(size_t width) {
    Layout layout;
    layout.width = static_cast<uint32_t>(width);
    return layout;
}

/// Counts by the kernel, dense.
std::vector<float> count(Device& device, const EventView& events,
                         const std::vector<IntervalRange>& ranges, const Layout& layout) {
    const PackedEvents packed = pack_events(events, exposure, layout.width, layout.height);
    Program program(device);
    const Tensor offsets = program.input(line(packed.offset.size()));
    const Tensor marks = program.input(line(packed.size() + 1));
    const Tensor positives = program.input(line(packed.size() + 1));
    const Tensor intervals = program.input(line(2 * ranges.size()));
    const Tensor counts = program.output(layout);
    record_event_histogram(program, offsets, marks, positives, intervals, counts);
    program.finish();
    program.write(offsets, packed.offset);
    program.write(marks, packed.mark);
    program.write(positives, packed.positives);
    program.write(intervals, std::as_bytes(std::span(ranges)));
    program.run();
    return to_dense(layout, program.read(counts));
}

Events at_times(std::initializer_list<int64_t> times) {
    Events events;
    for (const int64_t t : times) {
        events.push_back(t, 0, 0, 1);
    }
    return events;
}

std::vector<int64_t> sizes(const std::vector<IntervalRange>& ranges) {
    std::vector<int64_t> result;
    for (const IntervalRange& range : ranges) {
        result.push_back(int64_t{range.end} - range.begin);
    }
    return result;
}

} // namespace

TEST_SUITE("histogram") {
    TEST_CASE("an event on an edge of equal intervals opens the later one, whatever their number") {
        for (uint32_t intervals = 1; intervals <= 64; ++intervals) {
            const auto edges = even_edges(intervals);
            const Exposure long_one{1'600'000'000'000'000, 1'600'000'000'000'000 + 997 * intervals};
            for (uint32_t i = 0; i <= intervals; ++i) {
                CHECK(normalised_time(long_one.start + 997 * i, long_one) == edges[i]);
            }
        }
        const Events events = at_times({0, 5999, 6000, 6000, 114000, 120000});
        const auto ranges = paper_intervals(events.view(), exposure, even_edges(20));
        CHECK(ranges[0] == IntervalRange{0, 2});
        CHECK(ranges[1] == IntervalRange{2, 4});
        CHECK(ranges[19] == IntervalRange{4, 6});
    }

    TEST_CASE("the release rule closes both ends and drops every event of the latest time") {
        const double edges[] = {-0.5, 0, 0.5}; // 30, 60 and 90 ms
        const auto dropped = [&](std::initializer_list<int64_t> times) {
            return sizes(release_intervals(at_times(times).view(), exposure, edges));
        };
        // The two at the inner edge belong to both sets; the first loses them as its latest.
        CHECK(dropped({29999, 30000, 40000, 60000, 60000, 80000, 90000, 90001}) ==
              std::vector<int64_t>{2, 3});
        CHECK(dropped({60000, 60000, 60000}) == std::vector<int64_t>{0, 0});
        CHECK(dropped({}) == std::vector<int64_t>{0, 0});
        CHECK(dropped({31000, 31000, 59000, 59000, 59000}) == std::vector<int64_t>{2, 0});
    }

    TEST_CASE("edges: linspace as NumPy has it, equal ones, too few, going back") {
        const auto edges = linspace_edges(0.9027777777777778, 13);
        CHECK(edges.front() == -0.9027777777777778);
        CHECK(edges.back() == 0.9027777777777778);
        // numpy.linspace(-1, 1, 14)[[1, 5, 12]]
        const auto whole = linspace_edges(1, 13);
        CHECK(whole[1] == -0.8461538461538461);
        CHECK(whole[5] == -0.23076923076923073);
        CHECK(whole[12] == 0.8461538461538463);
        const Events events = at_times({0, 60000, 60000, 120000});
        const double same[] = {0, 0, 0};
        CHECK(sizes(paper_intervals(events.view(), exposure, same)) == std::vector<int64_t>{0, 2});
        CHECK(sizes(release_intervals(events.view(), exposure, same)) ==
              std::vector<int64_t>{0, 0});
        CHECK(paper_intervals(events.view(), exposure, std::span(same, 1)).empty());
        const double back[] = {0, -0.1};
        CHECK_THROWS_AS(paper_intervals(events.view(), exposure, back), Error);
        const double nan[] = {-1, std::numeric_limits<double>::quiet_NaN(), 1};
        CHECK_THROWS_AS(release_intervals(events.view(), exposure, nan), Error);
    }

    TEST_CASE("a million events of one pixel are all counted") {
        const auto device = Device::open();
        Events events;
        constexpr uint32_t kEvents = 1'000'000;
        for (uint32_t i = 0; i < kEvents; ++i) {
            events.push_back(static_cast<int64_t>(i) * 120000 / kEvents, 1, 0, i % 4 == 0 ? 1 : 0);
        }
        const auto ranges = paper_intervals(events.view(), exposure, even_edges(2));
        const auto counts = count(*device, events.view(), ranges, {4, 1, 3});
        CHECK(counts ==
              std::vector<float>{0, 125'000, 0, 0, 375'000, 0, 0, 125'000, 0, 0, 375'000, 0});
    }

    TEST_CASE("channels that fill up the last block become zero") {
        const auto device = Device::open();
        const Layout layout{6, 5, 9, 8, 1, 0};
        Layout full = layout;
        full.channels = 8;
        const PackedEvents none = pack_events({}, exposure, 9, 5);
        Program program(*device);
        const Tensor offsets = program.input(line(none.offset.size()));
        const Tensor empty = program.input(line(1));
        const Tensor intervals = program.input(line(6));
        const Tensor rule = program.input(line(4));
        const Tensor counts = program.output(full);
        program.clear(counts);
        // Eight keypoint channels put something other than zeros everywhere first.
        record_keypoints(program, offsets, empty, empty, rule, counts, 0, 8);
        record_event_histogram(program, offsets, empty, empty, intervals, counts.channels(0, 6));
        program.finish();
        program.write(offsets, none.offset);
        program.write(intervals, std::vector<uint32_t>(6, 0));
        program.write(rule, std::vector<uint32_t>(4, 0));
        program.run();
        CHECK(std::ranges::all_of(program.read(counts), [](float value) { return value == 0; }));
    }

    TEST_CASE("a result larger than the device can bind is counted in groups") {
        const auto device = Device::open();
        DeviceInfo info = device->info();
        const Layout small{26, 10, 10, 8, 0, 0};
        info.max_storage_range = 2 * 3200 + kBindingAlignment; // two blocks of eight channels
        const auto groups = channel_groups(info, small, 8);
        REQUIRE(groups.size() == 2);
        CHECK(groups[1].first == 16);
        CHECK(groups[1].count == 10);
        CHECK_THROWS_AS(channel_groups(info, small, 8, 16), Error);

        const uint64_t range = device->info().max_storage_range;
        if (range > uint64_t{256} << 20) {
            return; // nothing of a sensible size exceeds it
        }
        // Long rows of few pixels each: the planes are large, the counting is quick.
        Layout layout{6, 2, 3, 1, 0, 0};
        layout.pitch = static_cast<uint32_t>(range / 4 / 2 / 5);
        CaseRandom random(7);
        const Events events = random_events(random, exposure, 3, 2, 500, 3);
        const auto edges = even_edges(3);
        const auto counts =
            count(*device, events.view(), paper_intervals(events.view(), exposure, edges), layout);
        const auto expected = reference::histogram(events.view(), exposure, edges, false, 3, 2);
        CHECK(std::ranges::equal(counts, expected));
    }

    TEST_CASE("the training code counts the same events") {
        const auto device = Device::open();
        for (const std::string name : {"paper-173x131", "paper-240x180", "release-173x131"}) {
            CAPTURE(name);
            const SafeTensors file(std::string(ECIR_TEST_DATA) + "/fixtures/ecir-" + name +
                                   ".safetensors");
            const auto& t = file.get("input.t").values;
            Events events;
            for (size_t i = 0; i < t.size(); ++i) {
                events.push_back(static_cast<int64_t>(t[i]),
                                 static_cast<uint16_t>(file.get("input.x").values[i]),
                                 static_cast<uint16_t>(file.get("input.y").values[i]),
                                 file.get("input.p").values[i] > 0 ? 1 : 0);
            }
            const auto& shape = file.get("input.blurry").shape;
            const bool release = name.starts_with("release");
            const auto ranges =
                release ? release_intervals(events.view(), exposure, linspace_edges(1, 13))
                        : paper_intervals(events.view(), exposure, even_edges(20));
            const auto channels = static_cast<uint32_t>(2 * ranges.size());
            const Layout layout{channels, shape[0], shape[1], 8, 1, 0};
            const auto counts = count(*device, events.view(), ranges, layout);
            const auto& sums = file.get("output.histogram_sum", {channels});
            const size_t pixels = size_t{shape[0]} * shape[1];
            for (uint32_t c = 0; c < channels; ++c) {
                double sum = 0;
                for (size_t p = 0; p < pixels; ++p) {
                    sum += counts[c * pixels + p];
                }
                CHECK(sum == sums[c]);
            }
        }
    }
}
