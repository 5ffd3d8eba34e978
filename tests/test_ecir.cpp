#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "layers/curve.hpp"
#include "layers/ecir.hpp"
#include "layers/prior.hpp"
#include "tests/fixture.hpp"

// Whole networks with random weights against frames that the PyTorch network in tools/train
// computed in float64 (tools/train/make_fixtures.py): both variants, one size a multiple of 16 and
// one odd.

using ecir::test::Fixture;

TEST_SUITE("ecir") {
    TEST_CASE("the whole network agrees with PyTorch within 1e-4") {
        const auto device = ecir::Device::open();
        for (const char* name : {"ecir-paper-240x180", "ecir-paper-173x131", "ecir-release-240x180",
                                 "ecir-release-173x131"}) {
            CAPTURE(name);
            const Fixture fixture(name);
            ecir::EcirMethod initialisation(device, fixture.file, fixture.height, fixture.width,
                                            {.refine = 0});
            CHECK(fixture.difference(initialisation.frames(fixture.input()), "output.initial", 5) <
                  1e-4);
            ecir::EcirMethod whole(device, fixture.file, fixture.height, fixture.width, {});
            CHECK(fixture.difference(whole.frames(fixture.input()), "output.refined", 5) < 1e-4);
        }
    }

    TEST_CASE("the same input gives bit-identical frames") {
        const auto device = ecir::Device::open();
        const Fixture fixture("ecir-paper-173x131");
        ecir::EcirMethod method(device, fixture.file, fixture.height, fixture.width, {});
        const auto first = method.frames(fixture.input());
        const std::vector<float> kept(first.begin(), first.end());
        CHECK(std::ranges::equal(kept, method.frames(fixture.input())));
        ecir::EcirMethod again(device, fixture.file, fixture.height, fixture.width, {});
        CHECK(std::ranges::equal(kept, again.frames(fixture.input())));
    }

    TEST_CASE("a refinement that ends early gives the frames of as many iterations") {
        using ecir::EcirMethod;
        const auto device = ecir::Device::open();
        const Fixture fixture("ecir-paper-173x131");
        constexpr uint32_t kMost = 4;
        const auto make = [&](uint32_t refine, float until) {
            return EcirMethod(device, fixture.file, fixture.height, fixture.width,
                              {.refine = refine, .refine_until = until});
        };
        const auto frames_of = [&](EcirMethod method) {
            const auto frames = method.frames(fixture.input());
            return std::pair(std::vector<float>(frames.begin(), frames.end()),
                             method.work().updates);
        };
        const auto [last, updates] = frames_of(make(kMost, 0));
        REQUIRE(updates.size() == kMost);
        REQUIRE(std::ranges::is_sorted(updates, std::greater<>())); // so that each can be the last
        for (uint32_t made = 1; made <= kMost; ++made) {
            CAPTURE(made);
            const auto [full, whole] = frames_of(make(made, 0));
            const auto [early, seen] = frames_of(make(kMost, 255 * updates[made - 1] * 1.0001F));
            CHECK(std::ranges::equal(seen, std::span(updates).first(made)));
            CHECK(std::ranges::equal(whole, seen));
            CHECK(early == full);
            CHECK((made == kMost || early != last));
        }
        CHECK(frames_of(make(0, 1)).second.empty());
    }

    TEST_CASE("each of two frames under way ends its own refinement") {
        const auto device = ecir::Device::open();
        const Fixture fixture("ecir-paper-173x131");
        const ecir::FrameInput input = fixture.input();
        ecir::FrameInput dark = input; // little to refine
        const std::vector<float> black(input.blurry.size());
        dark.blurry = black;
        dark.events = {};
        const auto updates_of = [&](ecir::EcirMethod& method, const ecir::FrameInput& frame) {
            method.frames(frame);
            return method.work().updates;
        };
        ecir::EcirMethod whole(device, fixture.file, fixture.height, fixture.width,
                               {.refine = 3, .refine_until = 0});
        const float until = updates_of(whole, dark)[1] * 1.001F;
        REQUIRE(updates_of(whole, input)[1] > until);

        ecir::EcirMethod method(device, fixture.file, fixture.height, fixture.width,
                                {.refine = 3, .refine_until = 255 * until});
        std::vector<std::vector<float>> alone;
        std::vector<std::vector<float>> updates;
        for (const ecir::FrameInput* each : {&std::as_const(dark), &input}) {
            const auto frames = method.frames(*each);
            alone.emplace_back(frames.begin(), frames.end());
            updates.push_back(method.work().updates);
        }
        CHECK(updates[0].size() < 3);
        CHECK(updates[1].size() == 3);
        method.begin(dark);
        method.begin(input);
        for (size_t i = 0; i < 2; ++i) {
            CHECK(std::ranges::equal(method.finish(), alone[i]));
            CHECK(method.work().updates == updates[i]);
        }
        method.begin(input);
        const auto two = {-1.0, 1.0};
        dark.times = two; // another program: what is under way is set aside
        method.begin(dark);
        CHECK(std::ranges::equal(method.finish(), alone[1]));
        CHECK(method.work().updates == updates[1]);
        method.finish();
        CHECK(!method.work().updates.empty());
    }

    TEST_CASE("paper: half the light gives half the frames, be it ever so dark") {
        const auto device = ecir::Device::open();
        const Fixture fixture("ecir-paper-173x131");
        ecir::EcirMethod method(device, fixture.file, fixture.height, fixture.width, {});
        const auto lit = [&](float light) {
            std::vector<float> blurry = fixture.file.get("input.blurry").values;
            std::ranges::transform(blurry, blurry.begin(), [&](float v) { return light * v; });
            ecir::FrameInput input = fixture.input();
            input.blurry = blurry;
            const auto frames = method.frames(input);
            return std::vector<float>(frames.begin(), frames.end());
        };
        const auto dim = lit(0.2F);
        const auto dark = lit(0.01F);
        float largest = 0;
        for (size_t i = 0; i < dim.size(); ++i) {
            largest = std::max(largest, std::abs(dim[i] - 20 * dark[i]));
        }
        CHECK(largest < 1e-4F);
    }

    TEST_CASE("paper: a dark frame's lamps, too, are the mean of their curves") {
        const auto device = ecir::Device::open();
        const Fixture fixture("ecir-paper-173x131");
        ecir::EcirMethod method(device, fixture.file, fixture.height, fixture.width, {.refine = 0});
        std::vector<float> blurry = fixture.file.get("input.blurry").values;
        std::ranges::transform(blurry, blurry.begin(), [](float v) { return 0.1F * v; });
        for (size_t i = 0; i < blurry.size(); i += 500) {
            blurry[i] = 0.9F;
        }
        const ecir::Quadrature rule = ecir::gauss_legendre(6); // exact for the curve, of degree 10
        ecir::FrameInput input = fixture.input();
        input.blurry = blurry;
        input.times = rule.nodes;
        const auto frames = method.frames(input);
        double largest = 0;
        for (size_t p = 0; p < blurry.size(); ++p) {
            double mean = 0;
            for (size_t f = 0; f < rule.nodes.size(); ++f) {
                mean += 0.5 * rule.weights[f] * frames[f * blurry.size() + p];
            }
            largest = std::max(largest, std::abs(mean - blurry[p]));
        }
        CHECK(largest < 1e-5);
    }

    TEST_CASE("paper: a pixel of too many events is one without; release takes it as it is") {
        const auto device = ecir::Device::open();
        for (const bool release : {false, true}) {
            CAPTURE(release);
            const Fixture fixture(release ? "ecir-release-173x131" : "ecir-paper-173x131");
            ecir::EcirMethod method(device, fixture.file, fixture.height, fixture.width,
                                    {.refine = 0});
            const auto with = [&](uint32_t count) { // events at (7, 7), and none of its own
                ecir::Events events;
                for (uint32_t i = 0; i < count; ++i) {
                    events.push_back(fixture.exposure.start, 7, 7, 1);
                }
                for (size_t i = 0; i < fixture.events.size(); ++i) {
                    if (fixture.events.x[i] != 7 || fixture.events.y[i] != 7) {
                        events.push_back(fixture.events.t[i], fixture.events.x[i],
                                         fixture.events.y[i], fixture.events.p[i]);
                    }
                }
                ecir::FrameInput input = fixture.input();
                input.events = events.view();
                const auto frames = method.frames(input);
                return std::vector<float>(frames.begin(), frames.end());
            };
            const auto none = with(0);
            const auto most = with(ecir::prior_busy_events);
            const auto more = with(ecir::prior_busy_events + 1);
            CHECK(most != none);
            CHECK((more == none) == !release);
        }
    }
}
