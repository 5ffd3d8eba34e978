#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "layers/deblur.hpp"
#include "layers/operations.hpp"
#include "runtime/error.hpp"
#include "tests/fixture.hpp"

// The library's main entry, on small scenes made of random events.
namespace {

using namespace ecir;
using ecir::test::code_of;

constexpr uint32_t kWidth = 37;
constexpr uint32_t kHeight = 26;
constexpr Exposure kExposure{1'600'000'000'000'000, 1'600'000'000'050'000};

/// In pairs side by side, as edges make them: single ones would pass for noise.
Events random_events(size_t count) {
    CaseRandom random(11);
    std::vector<int64_t> times;
    for (size_t i = 0; i < count / 2; ++i) {
        times.push_back(kExposure.start + random.integer(0, 50'000));
    }
    std::ranges::sort(times);
    Events events;
    for (const int64_t t : times) {
        const uint32_t x = random.integer(0, kWidth - 2);
        const auto y = static_cast<uint16_t>(random.integer(0, kHeight - 1));
        const auto polarity = static_cast<uint8_t>(random.integer(0, 1));
        events.push_back(t, static_cast<uint16_t>(x), y, polarity);
        events.push_back(t, static_cast<uint16_t>(x + 1), y, polarity);
    }
    return events;
}

const std::vector<float>& blurry() {
    static const std::vector<float> values = CaseRandom(12).values(kWidth * kHeight, 0.1, 0.9);
    return values;
}

std::span<const float> frame(const std::vector<float>& frames, size_t index) {
    return std::span(frames).subspan(index * kWidth * kHeight, kWidth * kHeight);
}

} // namespace

TEST_SUITE("deblur") {
    TEST_CASE("frames come in the order of the times, and one at a time as in company") {
        const auto device = Device::open();
        const Events events = random_events(3000);
        for (const char* model : {"edi", "ecir", "fusion"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            if (options.model == "ecir") {
                options.refine = 0; // the refinement lets frames learn from each other
            }
            Deblur deblur(device, options, kWidth, kHeight);
            const auto ordered =
                deblur.frames(blurry(), events.view(), kExposure, std::vector{-1.0, 0.25, 1.0});
            const auto mixed =
                deblur.frames(blurry(), events.view(), kExposure, std::vector{1.0, -1.0, 0.25});
            CHECK(std::ranges::equal(frame(ordered, 0), frame(mixed, 1)));
            CHECK(std::ranges::equal(frame(ordered, 1), frame(mixed, 2)));
            CHECK(std::ranges::equal(frame(ordered, 2), frame(mixed, 0)));
            const auto single =
                deblur.frames(blurry(), events.view(), kExposure, std::vector{0.25});
            CHECK(std::ranges::equal(frame(ordered, 1), single));
        }
    }

    TEST_CASE("the same time twice gives the same frame twice, refined as well") {
        const Events events = random_events(2000);
        for (const char* model : {"ecir", "fusion"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            Deblur deblur(Device::open(), options, kWidth, kHeight);
            const auto frames =
                deblur.frames(blurry(), events.view(), kExposure, std::vector{0.5, -0.5, 0.5});
            CHECK(test::all_finite(frames));
        }
    }

    TEST_CASE("without events in the exposure every frame is the blurry one") {
        const Events events = random_events(100);
        Deblur deblur(Device::open(), {}, kWidth, kHeight);
        const Exposure later{kExposure.end + 1, kExposure.end + 1000};
        const auto frames = deblur.frames(blurry(), events.view(), later, even_times(3));
        for (size_t i = 0; i < 3; ++i) {
            CHECK(std::ranges::equal(frame(frames, i), blurry()));
        }
        CHECK(deblur.frames(blurry(), events.view(), kExposure, {}).empty());
    }

    TEST_CASE("events outside the exposure change nothing") {
        const auto device = Device::open();
        Events events = random_events(1000);
        Deblur deblur(device, {}, kWidth, kHeight);
        const auto alone = deblur.frames(blurry(), events.view(), kExposure, even_times(2));
        events.push_back(kExposure.end + 1, 3, 3, 1);
        CHECK(deblur.frames(blurry(), events.view(), kExposure, even_times(2)) == alone);
    }

    TEST_CASE("more events than before, and another number of frames, record a new program") {
        const auto device = Device::open();
        Deblur deblur(device, {}, kWidth, kHeight);
        for (const auto& [count, frames] : {std::pair{200U, 2U}, {60'000U, 2U}, {200U, 5U}}) {
            const Events events = random_events(count);
            const auto got = deblur.frames(blurry(), events.view(), kExposure, even_times(frames));
            Deblur fresh(device, {}, kWidth, kHeight);
            CHECK(got == fresh.frames(blurry(), events.view(), kExposure, even_times(frames)));
        }
    }

    TEST_CASE("a frame begun before the last one is finished gives the same bits") {
        const auto device = Device::open();
        for (const char* model : {"edi", "ecir", "fusion"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            Deblur one(device, options, kWidth, kHeight);
            Deblur two(device, options, kWidth, kHeight);
            // Other numbers of frames and more events record the program anew, with a run under
            // way; without events there is no run.
            const std::vector<std::pair<size_t, uint32_t>> frames{
                {500, 2}, {900, 2}, {20'000, 2}, {0, 3}, {700, 3}, {600, 3}, {300, 1}};
            std::vector<std::vector<float>> expected;
            std::vector<std::optional<EdiThresholds>> thresholds;
            for (const auto& [count, times] : frames) {
                expected.push_back(one.frames(blurry(), random_events(count).view(), kExposure,
                                              even_times(times)));
                thresholds.push_back(one.thresholds());
            }
            for (size_t i = 0; i <= frames.size(); ++i) {
                if (i < frames.size()) {
                    two.begin(blurry(), random_events(frames[i].first).view(), kExposure,
                              even_times(frames[i].second));
                }
                if (i > 0) {
                    CAPTURE(i);
                    CHECK(two.finish() == expected[i - 1]);
                    CHECK(two.thresholds() == thresholds[i - 1]);
                }
            }
        }
    }

    TEST_CASE("a frame that cannot begin leaves the one under way as it is") {
        const auto device = Device::open();
        const Events events = random_events(500);
        const uint64_t pixels = uint64_t{kWidth} * kHeight;
        const std::vector<double> many(device->info().heap_bytes / (4 * pixels) + 1, 0.5);
        Deblur deblur(device, {}, kWidth, kHeight);
        const auto alone = deblur.frames(blurry(), events.view(), kExposure, even_times(2));
        deblur.begin(blurry(), events.view(), kExposure, even_times(2));
        CHECK(code_of([&] { deblur.begin(blurry(), events.view(), kExposure, many); }) ==
              ExitCode::resources);
        CHECK(deblur.finish() == alone);
        CHECK(deblur.frames(blurry(), events.view(), kExposure, even_times(2)) == alone);
    }

    TEST_CASE("after a number of frames that no memory holds the object works on") {
        const auto device = Device::open();
        const Events events = random_events(500);
        const uint64_t pixels = uint64_t{kWidth} * kHeight;
        const std::vector<double> many(device->info().heap_bytes / (4 * pixels) + 1, 0.5);
        for (const char* model : {"edi", "ecir", "fusion"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            Deblur deblur(device, options, kWidth, kHeight);
            const auto run = [&](std::span<const double> times) {
                return deblur.frames(blurry(), events.view(), kExposure, times);
            };
            const auto before = run(even_times(2));
            for (int i = 0; i < 2; ++i) {
                CHECK(code_of([&] { run(many); }) == ExitCode::resources);
            }
            CHECK(run(even_times(2)) == before);
        }
    }

    TEST_CASE("values that are no luminance are refused with their place") {
        const Events events = random_events(100);
        Deblur deblur(Device::open(), {}, kWidth, kHeight);
        for (const float wrong : {NAN, INFINITY, -INFINITY, -0.01F, 1.01F, 255.0F}) {
            auto values = blurry();
            values[3 * kWidth + 5] = wrong;
            CHECK_THROWS_WITH_AS(deblur.frames(values, events.view(), kExposure, std::vector{0.0}),
                                 doctest::Contains("x 5, y 3"), Error);
        }
        auto values = blurry();
        values[0] = 1.000001F;
        values[1] = -0.000001F;
        CHECK_NOTHROW(deblur.frames(values, events.view(), kExposure, std::vector{0.0}));
    }

    TEST_CASE("black and white pixels, events from 0 or from 1.6e15 on, and a single frame") {
        const auto device = Device::open();
        const Events events = random_events(2000);
        Events early = events;
        for (int64_t& t : early.t) {
            t -= kExposure.start;
        }
        std::vector<float> extremes(kWidth * kHeight);
        for (size_t i = 0; i < extremes.size(); ++i) {
            extremes[i] = i / 3 % 2 == 0 ? 0.0F : 1.0F;
        }
        for (const char* model : {"edi", "ecir", "fusion"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            Deblur deblur(device, options, kWidth, kHeight);
            const auto late = deblur.frames(extremes, events.view(), kExposure, even_times(1));
            CHECK(late.size() == extremes.size());
            CHECK(test::all_finite(late));
            CHECK(late == deblur.frames(extremes, early.view(),
                                        {0, kExposure.end - kExposure.start}, even_times(1)));
        }
    }

    TEST_CASE("what a model does not take is refused") {
        const auto device = Device::open();
        const auto open = [&](const auto& change) {
            DeblurOptions options;
            change(options);
            return code_of([&] { Deblur(device, options, kWidth, kHeight); });
        };
        using O = DeblurOptions;
        CHECK(open([](O& o) { o.model = "no-such-model"; }) == ExitCode::bad_input);
        CHECK(open([](O& o) { o.model = "/no/such/file.safetensors"; }) == ExitCode::bad_input);
        CHECK(open([](O& o) { o.keypoints = 10; }) == ExitCode::usage);
        CHECK(open([](O& o) { o.model = "ecir", o.keypoints = 11; }) == ExitCode::usage);
        CHECK(open([](O& o) { o.model = "ecir", o.keypoints = 10; }) == ExitCode::ok);
        CHECK(open([](O& o) { o.model = "ecir", o.thresholds = EdiThresholds{}; }) ==
              ExitCode::usage);
        CHECK(open([](O& o) { o.model = "edi", o.refine = 1; }) == ExitCode::usage);
        CHECK(open([](O& o) { o.model = "fusion", o.refine = 1; }) == ExitCode::ok);
        CHECK(open([](O& o) { o.model = "fusion", o.refine = 3; }) == ExitCode::usage);
        CHECK(open([](O& o) { o.model = "ecir", o.refine = 5; }) == ExitCode::ok);
        for (const float wrong : {0.0F, -0.2F, NAN, INFINITY}) {
            CHECK(open([&](O& o) { o.thresholds = {0.2F, wrong}; }) == ExitCode::usage);
        }
        Deblur deblur(device, {}, kWidth, kHeight);
        CHECK(code_of([&] { deblur.frames(blurry(), {}, kExposure, std::vector{1.5}); }) ==
              ExitCode::usage);
        CHECK(code_of([&] {
                  deblur.frames(std::vector<float>(3), {}, kExposure, std::vector{0.0});
              }) == ExitCode::bad_input);
    }

    TEST_CASE("colour follows the luminance, and keeps the frame where nothing changed") {
        const std::vector<float> colour = {0.2F, 0.4F, 0.6F, 0.0F, 1.0F, 0.5F};
        const std::vector<float> before = {0.4F, 0.5F};
        const auto same = recolour(colour, before, before, 3);
        const auto twice = recolour(colour, before, std::vector<float>{0.81F, 0.5F}, 3);
        for (size_t i = 0; i < colour.size(); ++i) {
            CHECK(same[i] == doctest::Approx(colour[i]).epsilon(1e-6));
            const double factor = i < 3 ? 2 : 1;
            CHECK(twice[i] == doctest::Approx((colour[i] + 0.01) * factor - 0.01).epsilon(1e-6));
        }
    }
}
