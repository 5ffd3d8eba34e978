#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "layers/deblur.hpp"
#include "layers/fusion.hpp"
#include "layers/motion.hpp"
#include "layers/operations.hpp"
#include "layers/reference/consistency.hpp"
#include "layers/reference/histogram.hpp"
#include "runtime/error.hpp"
#include "tests/fixture.hpp"

using namespace ecir;
using ecir::test::all_finite;
using ecir::test::code_of;
using ecir::test::Fixture;

namespace {

/// The fixture's times are not even ones.
struct FusionFixture : Fixture {
    EdiThresholds thresholds;

    FusionFixture() : Fixture("fusion-61x45") {
        const auto& exact = file.get("input.times").values;
        times.assign(exact.begin(), exact.end());
        const auto& both = file.get("input.thresholds", {2});
        thresholds = {both[0], both[1]};
    }
    [[nodiscard]] FrameInput input() const {
        FrameInput input = Fixture::input();
        input.thresholds = thresholds;
        return input;
    }
    [[nodiscard]] DeblurOptions options() const {
        DeblurOptions options;
        options.model = file.path().string();
        options.thresholds = thresholds;
        return options;
    }
};

} // namespace

TEST_SUITE("fusion") {
    TEST_CASE("the whole method agrees with PyTorch within 1e-4") {
        const auto device = Device::open();
        const FusionFixture fixture;
        FusionMethod method(device, fixture.file, fixture.height, fixture.width);
        const double difference =
            fixture.difference(method.frames(fixture.input()), "output.frames", 1);
        MESSAGE("largest difference ", difference);
        CHECK(difference < 1e-4);

        FusionMethod corrected(device, fixture.file, fixture.height, fixture.width,
                               FusionSteps::corrected);
        const auto frames = corrected.frames(fixture.input());
        CHECK(fixture.difference(frames, "output.corrected", 1) < 1e-4);
        CHECK(fixture.difference(frames, "output.frames", 1) > 0.003);
    }

    TEST_CASE("the motion agrees with numpy within 1e-3 pixels a gap between anchors") {
        const auto device = Device::open();
        const FusionFixture fixture;
        const uint32_t height = fixture.height;
        const uint32_t width = fixture.width;
        Program program(*device);
        const EventTensors events(program, height, width,
                                  EventTensors::capacity_for(fixture.events.size()));
        const Tensor blurry = program.input({1, height, width});
        const Tensor thresholds = program.input({1, 1, 2});
        const PriorExposure exposure{
            program.temporary({anchor_count, height, width}),
            program.temporary({anchor_count, height, width}), program.temporary({1, height, width}),
            program.temporary({prior_windows + 1, (height + 1) / 2, (width + 1) / 2})};
        const Tensor moved = program.output(motion_layout(height, width));
        const Layout& field = moved.layout();
        record_prior(
            program,
            {events.offset, events.time, events.mark, events.positives, blurry, thresholds},
            exposure);
        record_motion(program, exposure.logarithms, moved,
                      program.temporary({2 * anchor_count, field.height, field.width}));
        program.finish();
        events.write(program, pack_events(fixture.events.view(), fixture.exposure, width, height));
        program.write(blurry, fixture.file.get("input.blurry").values);
        program.write(thresholds, fixture.file.get("input.thresholds").values);
        program.run();
        const auto found = to_dense(field, program.read(moved));
        const auto& expected = fixture.file.get("output.moved").values;
        REQUIRE(found.size() == expected.size());
        for (size_t i = 0; i < found.size(); ++i) {
            REQUIRE(std::abs(found[i] - expected[i]) < 1e-3F);
        }
    }

    TEST_CASE("times in any number give the same bits as among others") {
        const auto device = Device::open();
        const FusionFixture fixture;
        FusionMethod method(device, fixture.file, fixture.height, fixture.width);
        const auto first = method.frames(fixture.input());
        const std::vector<float> kept(first.begin(), first.end());
        CHECK(std::ranges::equal(kept, method.frames(fixture.input())));

        const size_t pixels = size_t{fixture.width} * fixture.height;
        const std::array twice = {fixture.times[1], fixture.times[1]};
        FrameInput input = fixture.input();
        input.times = twice;
        const auto frames = method.frames(input);
        REQUIRE(frames.size() == 2 * pixels);
        CHECK(std::ranges::equal(frames.first(pixels), std::span(kept).subspan(pixels, pixels)));
        CHECK(std::ranges::equal(frames.first(pixels), frames.last(pixels)));

        std::vector<double> many; // more than images_at_once() of this size; far from all exposure
        many.reserve(20);
        for (int i = 0; i < 20; ++i) {
            many.push_back(fixture.times[1] + 0.01 * i);
        }
        input.times = many;
        const auto all = method.frames(input);
        const std::vector<float> several(all.begin(), all.end());
        CHECK(std::ranges::equal(std::span(several).first(pixels),
                                 std::span(kept).subspan(pixels, pixels)));
        for (const size_t index : {8, 19}) {
            input.times = std::span(many).subspan(index, 1);
            CAPTURE(index);
            CHECK(std::ranges::equal(method.frames(input),
                                     std::span(several).subspan(index * pixels, pixels)));
        }
    }

    TEST_CASE("the anchors' ranks: nearest first, the earlier of two at one distance") {
        using Ranks = std::array<uint32_t, anchor_count>;
        CHECK(Instant(-1).rank == Ranks{0, 1, 2, 3, 4, 5, 6, 7, 8});
        CHECK(Instant(1).rank == Ranks{8, 7, 6, 5, 4, 3, 2, 1, 0});
        CHECK(Instant(0).rank == Ranks{7, 5, 3, 1, 0, 2, 4, 6, 8});
        CHECK(Instant(0.125).rank == Ranks{8, 6, 4, 2, 0, 1, 3, 5, 7});
        CHECK(Instant(1).below == 7);
        CHECK(Instant(0.25).below == 5);
        CHECK(Instant(0.2499).below == 4);
        CHECK_THROWS_AS(Instant(1.0001), Error);
        CHECK_THROWS_AS(Instant(std::nan("")), Error);
    }

    TEST_CASE(
        "shares of the exposure: what is nearest to each time, nothing where times leave gaps") {
        const auto shares = [](const std::vector<double>& times) {
            std::vector<float> found;
            for (const Instant& instant : make_instants(times)) {
                found.push_back(instant.share);
            }
            return found;
        };
        CHECK(shares({-1, -0.5, 0, 0.5, 1}) ==
              std::vector<float>{0.125F, 0.25F, 0.25F, 0.25F, 0.125F});
        CHECK(shares({0.75, -0.75, 0.25, -0.25}) == std::vector<float>(4, 0.25F));
        CHECK(shares({0, -0.5, 0.5, 0, 1, -1}) ==
              std::vector<float>{0.125F, 0.25F, 0.25F, 0.125F, 0.125F, 0.125F});
        CHECK(shares({-1, 0, 1}) == std::vector<float>(3, 0));
        CHECK(shares({-0.7, -0.25, 0.25, 0.75}) ==
              std::vector<float>(4, 0)); // the start is too far
        CHECK(shares({0.3}) == std::vector<float>(1, 0));
        CHECK(shares({}).empty());
    }

    TEST_CASE("frames that cover the exposure get one change, with which their mean is the "
              "captured frame") {
        const auto device = Device::open();
        const FusionFixture fixture;
        const size_t pixels = size_t{fixture.width} * fixture.height;
        FusionMethod method(device, fixture.file, fixture.height, fixture.width);
        FusionMethod without(device, fixture.file, fixture.height, fixture.width,
                             FusionSteps::prior);
        FrameInput input = fixture.input();
        const auto all = even_times(9);
        input.times = all;
        const auto covering = method.frames(input);
        const std::vector<float> together(covering.begin(), covering.end());
        const auto uncorrected = without.frames(input);
        const std::vector<float> prior(uncorrected.begin(), uncorrected.end());
        std::vector<float> alone;
        for (const double& time : all) {
            input.times = std::span(&time, 1);
            const auto frame = method.frames(input);
            alone.insert(alone.end(), frame.begin(), frame.end());
        }
        std::vector<float> shares;
        for (const Instant& instant : make_instants(all)) {
            shares.push_back(instant.share);
        }
        const auto expected = reference::consistent(
            alone, prior, fixture.file.get("input.blurry").values, shares, fixture.width);
        double most = 0;
        double change = 0;
        for (size_t i = 0; i < all.size() * pixels; ++i) {
            most = std::max(most, std::abs(together[i] - expected[i]));
            change = std::max(change, std::abs(double{together[i]} - alone[i]));
        }
        CHECK(most < 1e-5);
        CHECK(change > 0.01);
    }

    TEST_CASE("thresholds given or estimated, and the options that it lacks") {
        const auto device = Device::open();
        const FusionFixture fixture;
        const auto& blurry = fixture.file.get("input.blurry").values;
        const auto run = [&](const DeblurOptions& options) {
            Deblur deblur(device, options, fixture.width, fixture.height);
            CHECK(all_finite(
                deblur.frames(blurry, fixture.events.view(), fixture.exposure, fixture.times)));
            return deblur.thresholds();
        };
        DeblurOptions options = fixture.options();
        CHECK(run(options) == fixture.thresholds);
        options.thresholds.reset();
        const auto estimated = run(options);
        REQUIRE(estimated.has_value());
        CHECK(*estimated != fixture.thresholds);
        options.model = "edi";
        CHECK(run(options) == estimated);

        DeblurOptions wrong = fixture.options();
        wrong.keypoints = 10;
        CHECK(code_of([&] { Deblur(device, wrong, fixture.width, fixture.height); }) ==
              ExitCode::usage);
        CHECK_THROWS_WITH_AS(FusionMethod(device, Fixture("ecir-paper-173x131").file, 16, 16),
                             doctest::Contains("'trunk'"), Error);
    }

    TEST_CASE("the smallest image, no events, more events than before, and very many at a pixel") {
        const auto device = Device::open();
        const FusionFixture fixture;
        FusionMethod method(device, fixture.file, 17, 16);
        CaseRandom random(4);
        const auto blurry = random.values(size_t{17} * 16, 0, 1);
        const std::array times = {-1.0, 0.1, 1.0};
        const Exposure exposure{0, 100'000};
        for (const uint32_t count : {0U, 20'000U}) {
            const Events events = random_events(random, exposure, 16, 17, count, 32);
            const auto frames = method.frames({blurry, events.view(), exposure, times});
            CHECK(frames.size() == times.size() * blurry.size());
            CHECK(all_finite(frames));
        }
        // More than the kernels take: as if there were none.
        Events busy;
        for (int64_t i = 0; i < 70'000; ++i) {
            busy.push_back(i, 5, 5, static_cast<uint8_t>(i % 2));
        }
        CHECK(prior_busy_pixels(busy.view(), 16, 17) == 1);
        const auto frames = method.frames({blurry, busy.view(), exposure, times});
        const std::vector<float> kept(frames.begin(), frames.end());
        CHECK(std::ranges::equal(kept, method.frames({blurry, {}, exposure, times})));
    }
}
