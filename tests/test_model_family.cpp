#include <doctest/doctest.h>

#include <fstream>

#include "layers/deblur.hpp"
#include "layers/model_family.hpp"
#include "layers/operations.hpp"
#include "runtime/error.hpp"
#include "tests/fixture.hpp"
#include "tests/test_io_support.hpp"

using namespace ecir;
using ecir::test::code_of;

namespace {

ModelFamily family_of(const std::string& text) {
    const test::TemporaryFolder folder;
    std::ofstream(folder / "family.json") << text;
    return ModelFamily(folder / "family.json");
}

const char* const kTwo = R"({"members": [
    {"model": "small", "loss": [{"events_per_pixel": 0.1, "db": 0.0}, {"events_per_pixel": 10, "db": 1.0}]},
    {"model": "large", "loss": []}]})";

} // namespace

TEST_SUITE("model family") {
    TEST_CASE("losses run with the logarithm of the events a pixel") {
        const ModelFamily family = family_of(kTwo);
        CHECK(family.loss(0, 1e-6) == 0);
        CHECK(family.loss(0, 1) == doctest::Approx(0.5));
        CHECK(family.loss(0, 1e6) == 1);
        CHECK(family.loss(1, 1) == 0);
    }

    TEST_CASE("the smallest that the quality allows") {
        const ModelFamily family = family_of(kTwo);
        CHECK(family.choose(0.12, Quality::best, 2) == 0);
        CHECK(family.choose(0.5, Quality::best, 2) == 1);
        CHECK(family.choose(0.5, Quality::balanced, 2) == 0);
        CHECK(family.choose(5, Quality::balanced, 2) == 1);
        CHECK(family.choose(5, Quality::fast, 2) == 0);
        CHECK(family.choose(5, Quality::best, 1) == 0);
    }

    TEST_CASE("what is wrong with a table is said") {
        for (const char* text :
             {"", "{}", R"({"members": []})", R"({"members": [{"model": "a"}]})",
              R"({"members": [{"model": "a", "loss": [{"events_per_pixel": 1, "db": 0}]}]})",
              R"({"members": [{"model": "a", "loss": []}, {"model": "b", "loss": []}]})",
              R"({"members": [{"model": "a", "loss": [{"events_per_pixel": 2, "db": 0},
                 {"events_per_pixel": 1, "db": 0}]}, {"model": "b", "loss": []}]})"}) {
            CAPTURE(text);
            CHECK(code_of([&] { family_of(text); }) == ExitCode::bad_input);
        }
        CHECK(code_of([] { ModelFamily("/no/such/family.json"); }) == ExitCode::bad_input);
    }

    TEST_CASE("the shipped family's models are there, and auto takes one of them") {
        const ModelFamily family = ModelFamily::shipped();
        const auto& members = family.members();
        REQUIRE(members.size() >= 2);
        constexpr uint32_t kSide = 32;
        const Exposure exposure{0, 20'000};
        Events events; // a bright edge that crosses the image
        for (uint16_t x = 0; x < kSide; ++x) {
            for (uint16_t y = 0; y < kSide; ++y) {
                events.push_back(500 * x, x, y, 1);
                events.push_back(500 * x, x, y, 1);
            }
        }
        const std::vector<float> blurry(size_t{kSide} * kSide, 0.5F);
        const std::vector<double> times{0.0};
        const auto device = Device::open();
        const auto run = [&](DeblurOptions options) {
            options.thresholds = EdiThresholds{0.2F, 0.2F};
            Deblur deblur(device, options, kSide, kSide);
            const auto frames = deblur.frames(blurry, events.view(), exposure, times);
            return std::pair(deblur.model(), frames);
        };
        DeblurOptions fast;
        fast.quality = Quality::fast;
        DeblurOptions named;
        named.model = members.front().model;
        CHECK(run(fast) == run(named));
        CHECK(run(fast).first == members.front().model);
        DeblurOptions bounded;
        bounded.largest = members.front().model;
        CHECK(run(bounded).first == members.front().model);
        bounded.largest = "ecir";
        CHECK(code_of([&] { run(bounded); }) == ExitCode::usage);
    }
}
