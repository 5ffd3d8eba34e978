#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "layers/deblur.hpp"
#include "layers/esl_net.hpp"
#include "layers/reference/histogram.hpp"
#include "runtime/error.hpp"
#include "tests/fixture.hpp"

using namespace ecir;
using ecir::test::code_of;
using ecir::test::Fixture;

namespace {

constexpr const char* kFixture = "esl-net-41x29";

/// Which range of outward_intervals() an event is in, as the rule is written.
size_t range_of(int64_t t, const Exposure& exposure, int64_t instant, int64_t bins) {
    const int64_t distance = std::abs(t - instant);
    int64_t bin = 0;
    while (bin + 1 < bins && distance * bins >= (bin + 1) * exposure.duration()) {
        ++bin;
    }
    return static_cast<size_t>(t < instant ? bins - 1 - bin : bins + bin);
}

} // namespace

TEST_SUITE("esl net") {
    TEST_CASE("the network agrees with PyTorch within 0.02 grey levels, at times in any number") {
        const auto device = Device::open();
        const Fixture fixture(kFixture);
        EslNetMethod method(device, fixture.file, fixture.height, fixture.width);
        const auto all = method.frames(fixture.input());
        CHECK(255 * fixture.difference(all, "output.frames", 1) < 0.02);
        const std::vector<float> kept(all.begin(), all.end());

        // One time alone, and one twice: the same bits.
        const size_t pixels = size_t{fixture.width} * fixture.height;
        const std::array twice = {fixture.times[2], fixture.times[2]};
        FrameInput input = fixture.input();
        input.times = twice;
        const auto frames = method.frames(input);
        REQUIRE(frames.size() == 2 * pixels);
        CHECK(
            std::ranges::equal(frames.first(pixels), std::span(kept).subspan(2 * pixels, pixels)));
        CHECK(std::ranges::equal(frames.first(pixels), frames.last(pixels)));
    }

    TEST_CASE("intervals outwards from a frame's instant, the exposure's ends and edges included") {
        for (const int64_t start : {int64_t{0}, int64_t{1'600'000'000'000'000}}) {
            const Exposure exposure{start, start + 120'000};
            CaseRandom random(3);
            const Events events = random_events(random, exposure, 9, 7, 3000, 20);
            for (const uint32_t bins : {1U, 7U, 20U}) {
                for (const int64_t tick : {0, 1, 6000, 40'000, 60'000, 119'999, 120'000}) {
                    const double time = 2 * static_cast<double>(tick) / 120'000 - 1;
                    const auto ranges = outward_intervals(events.view(), exposure, time, bins);
                    REQUIRE(ranges.size() == 2 * bins);
                    for (size_t i = 0; i < events.size(); ++i) {
                        const auto& range =
                            ranges.at(range_of(events.t[i], exposure, start + tick, bins));
                        REQUIRE(range.begin <= i);
                        REQUIRE(i < range.end);
                    }
                }
            }
        }
    }

    TEST_CASE("a frame between two microseconds: no event is at its instant") {
        Events events;
        for (const int64_t t : {0, 33'333, 33'334, 100'000}) {
            events.push_back(t, 0, 0, 1);
        }
        const auto ranges = outward_intervals(events.view(), {0, 100'000}, -1.0 / 3, 20);
        CHECK(ranges[19] == IntervalRange{1, 2});
        CHECK(ranges[20] == IntervalRange{2, 3});
        CHECK(outward_intervals({}, {0, 100'000}, 0, 20) ==
              std::vector<IntervalRange>(40, IntervalRange{}));
    }

    TEST_CASE("intervals of an empty exposure, none at all, and a time outside are refused") {
        const Exposure exposure{0, 1000};
        CHECK_THROWS_AS(outward_intervals({}, {5, 5}, 0, 20), Error);
        CHECK_THROWS_AS(outward_intervals({}, {5, 4}, 0, 20), Error);
        CHECK_THROWS_AS(outward_intervals({}, exposure, 0, 0), Error);
        CHECK_THROWS_AS(outward_intervals({}, exposure, 1.01, 20), Error);
        CHECK_THROWS_AS(outward_intervals({}, exposure, NAN, 20), Error);
    }

    TEST_CASE("a convolution that may bind no whole block is refused") {
        const auto device = Device::open();
        const std::vector<float> weight(16);
        CHECK_THROWS_WITH_AS(Conv(*device, {.out_channels = 16, .kernel = 1, .most_bound = 4},
                                  {channel_range(0, 1)}, weight, {}),
                             doctest::Contains("most_bound"), Error);
    }

    TEST_CASE("the training code counts the same events") {
        const Fixture fixture(kFixture);
        const auto& sums = fixture.file.get("output.counts", {4, 40});
        for (size_t frame = 0; frame < 4; ++frame) {
            const auto ranges = outward_intervals(fixture.events.view(), fixture.exposure,
                                                  fixture.times[frame], EslNet::bins);
            std::array<float, 40> counts{};
            for (size_t r = 0; r < ranges.size(); ++r) {
                const size_t bin = r < 20 ? 19 - r : r - 20;
                for (size_t i = ranges[r].begin; i < ranges[r].end; ++i) {
                    const bool brighter = (fixture.events.p[i] != 0) == (r >= 20);
                    counts.at(2 * bin + (brighter ? 0 : 1)) += 1;
                }
            }
            CHECK(std::ranges::equal(counts, std::span(sums).subspan(frame * 40, 40)));
        }
    }

    TEST_CASE("the file's metadata choose the network, and options that it lacks are refused") {
        const auto device = Device::open();
        const Fixture fixture(kFixture);
        DeblurOptions options;
        options.model = fixture.file.path().string();
        Deblur deblur(device, options, fixture.width, fixture.height);
        const auto& blurry = fixture.file.get("input.blurry").values;
        const std::array times = {1.0, -1.0};
        const auto frames = deblur.frames(blurry, fixture.events.view(), fixture.exposure, times);
        EslNetMethod method(device, fixture.file, fixture.height, fixture.width);
        FrameInput input = fixture.input();
        const std::array ascending = {-1.0, 1.0};
        input.times = ascending;
        const auto expected = method.frames(input);
        const size_t pixels = blurry.size();
        CHECK(std::ranges::equal(std::span(frames).first(pixels), expected.last(pixels)));
        CHECK(std::ranges::equal(std::span(frames).last(pixels), expected.first(pixels)));

        const auto refused = [&](const DeblurOptions& wrong) {
            return code_of([&] { Deblur(device, wrong, fixture.width, fixture.height); }) ==
                   ExitCode::usage;
        };
        DeblurOptions wrong = options;
        wrong.refine = 1;
        CHECK(refused(wrong));
        wrong = options;
        wrong.keypoints = 10;
        CHECK(refused(wrong));
        wrong = options;
        wrong.thresholds = EdiThresholds{};
        CHECK(refused(wrong));
        CHECK_THROWS_WITH_AS(EslNetMethod(device, Fixture("ecir-paper-173x131").file, 16, 16),
                             doctest::Contains("'esl.image_d.weight'"), Error);
    }

    TEST_CASE("the smallest image, and more events than before") {
        const auto device = Device::open();
        const Fixture fixture(kFixture);
        EslNetMethod method(device, fixture.file, 16, 16);
        CaseRandom random(4);
        const auto blurry = random.values(256, 0, 1);
        const std::array times = {0.125};
        for (const uint32_t count : {0U, 20'000U}) {
            const Exposure exposure{0, 100'000};
            const Events events = random_events(random, exposure, 16, 16, count, 20);
            const auto frames = method.frames({blurry, events.view(), exposure, times});
            CHECK(frames.size() == 256);
            CHECK(test::all_finite(frames));
        }
    }
}
