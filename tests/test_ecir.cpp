#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "layers/ecir.hpp"

// Whole networks with random weights against frames that the PyTorch network in tools/train
// computed in float64 (tools/train/make_fixtures.py): both variants, one size a multiple of 16 and
// one odd.
namespace {

using ecir::SafeTensors;

struct Fixture {
    SafeTensors file;
    uint32_t height;
    uint32_t width;
    ecir::Events events;
    ecir::Exposure exposure;
    std::vector<double> times;

    explicit Fixture(const std::string& name)
        : file(std::string(ECIR_TEST_DATA) + "/fixtures/" + name + ".safetensors"),
          height(file.get("input.blurry").shape[0]), width(file.get("input.blurry").shape[1]) {
        const auto& t = file.get("input.t").values;
        for (size_t i = 0; i < t.size(); ++i) {
            events.push_back(static_cast<int64_t>(t[i]),
                             static_cast<uint16_t>(file.get("input.x").values[i]),
                             static_cast<uint16_t>(file.get("input.y").values[i]),
                             static_cast<uint8_t>(file.get("input.p").values[i]));
        }
        exposure = {static_cast<int64_t>(file.get("input.exposure").values[0]),
                    static_cast<int64_t>(file.get("input.exposure").values[1])};
        // linspace(-1, 1, d), which the file holds rounded to float32.
        const auto count = file.get("input.times").values.size();
        for (size_t i = 0; i < count; ++i) {
            times.push_back(-1 + 2 * static_cast<double>(i) / static_cast<double>(count - 1));
        }
    }

    [[nodiscard]] ecir::FrameInput input() const {
        return {file.get("input.blurry").values, events.view(), exposure, times};
    }

    /// Largest difference to the file's frames, which hold every fifth pixel of every fifth row.
    [[nodiscard]] double difference(std::span<const float> frames, const std::string& name) const {
        const auto& expected = file.get(name);
        double largest = 0;
        size_t i = 0;
        for (size_t d = 0; d < expected.shape[0]; ++d) {
            for (size_t y = 0; y < height; y += 5) {
                for (size_t x = 0; x < width; x += 5) {
                    const double difference = std::abs(
                        double{frames[(d * height + y) * width + x]} - expected.values[i++]);
                    largest = std::isfinite(difference) ? std::max(largest, difference) : INFINITY;
                }
            }
        }
        return i == expected.values.size() ? largest : INFINITY;
    }
};

} // namespace

TEST_SUITE("ecir") {
    TEST_CASE("the whole network agrees with PyTorch within 1e-4") {
        const auto device = ecir::Device::open();
        for (const char* name : {"ecir-paper-240x180", "ecir-paper-173x131", "ecir-release-240x180",
                                 "ecir-release-173x131"}) {
            CAPTURE(name);
            const Fixture fixture(name);
            ecir::EcirMethod initialisation(device, fixture.file, fixture.height, fixture.width, 0);
            CHECK(fixture.difference(initialisation.frames(fixture.input()), "output.initial") <
                  1e-4);
            ecir::EcirMethod whole(device, fixture.file, fixture.height, fixture.width, {});
            CHECK(fixture.difference(whole.frames(fixture.input()), "output.refined") < 1e-4);
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
