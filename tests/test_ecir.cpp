#include <doctest/doctest.h>

#include <algorithm>

#include "layers/ecir.hpp"
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
            ecir::EcirMethod initialisation(device, fixture.file, fixture.height, fixture.width, 0);
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
}
