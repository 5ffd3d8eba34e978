#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "layers/conv.hpp"
#include "tests/cli_support.hpp"
#include "tools/io/npy.hpp"

using namespace ecir;
using namespace ecir::test;
using nlohmann::json;

namespace {

const Arguments kHalf{"--precision", "float16"};

DeviceInfo default_device() {
    return Device::open()->info();
}

/// What a GPU would run, on any device.
Surroundings gpu_kernels() {
    Surroundings around;
    around.environment = {{"ECIR_CONV", "matrix"}};
    return around;
}

} // namespace

TEST_SUITE("cli precision") {
    TEST_CASE("where convolutions have no float16 kernels it is wrong usage, and nothing is left") {
        if (conv_family(default_device()) == ConvFamily::tile) {
            return;
        }
        const Scene& scene = Scene::get();
        const std::string out = scene.result("refused.npy");
        must_fail(2, scene.deblur(out, kHalf), {"float16", "ECIR_CONV=tile"});
        CHECK(!fs::exists(out));
        must_fail(2, Arguments{"bench", "--model", "edi"} + kHalf, {"float16", "ECIR_CONV=tile"});
        must_fail(2, Arguments{"chart", "--scenes", scene.grey.string(), "-m", "edi"} + kHalf,
                  {"float16", "ECIR_CONV=tile"});
    }

    TEST_CASE("wrong usage") {
        const Scene& scene = Scene::get();
        const Arguments other{"--precision", "float8"};
        must_fail(2, scene.deblur(scene.result("no.npy"), other), {"--precision", "float8"});
        must_fail(2, Arguments{"bench", "--op", "^fusion_mix$"} + kHalf, {"--model"});
    }

    TEST_CASE("float16 frames are those of float32 but for rounding") {
        if (!has_float16(default_device())) {
            return;
        }
        const Scene& scene = Scene::get();
        for (const char* model : {"fusion-small", "ecir"}) {
            CAPTURE(model);
            const Arguments what{"-m", model, "--times", "0", "0.7"};
            const std::string whole = scene.result(std::string(model) + "-32.npy");
            const std::string half = scene.result(std::string(model) + "-16.npy");
            must(scene.deblur(whole, what), gpu_kernels());
            must(scene.deblur(half, what + kHalf), gpu_kernels());
            const double rms =
                rms_difference(io::read_npy(whole).values, io::read_npy(half).values);
            CHECK(rms > 0);
            CHECK(rms < 1e-3);
        }
    }

    TEST_CASE("chart and bench tell precisions apart") {
        if (!has_float16(default_device())) {
            return;
        }
        const Scene& scene = Scene::get();
        const Arguments both{"--precision", "float16", "float32"};
        const json points = json::parse(must(Arguments{"chart", "--scenes", scene.grey.string(),
                                                       "-m", "fusion-small", "edi", "--json"} +
                                                 both,
                                             gpu_kernels())
                                            .out)
                                .at("points");
        // At two sizes: the network with all, one and none of its refinements in both precisions,
        // and edi, which has no convolutions.
        REQUIRE(points.size() == 2 * (2 * 3 + 1));
        CHECK(points[0].at("name") == "fusion-small");
        CHECK(points[0].at("precision") == "float32");
        CHECK(points[3].at("name") == "fusion-small, float16");
        CHECK(points[3].at("precision") == "float16");
        CHECK(points[3].at("psnr") != points[0].at("psnr"));
        CHECK(points[3].at("psnr").get<double>() ==
              doctest::Approx(points[0].at("psnr").get<double>()).epsilon(1e-3));
        CHECK(points[6].at("name") == "edi");

        const json bench = json::parse(must(Arguments{"bench", "--model", "fusion-small", "--size",
                                                      "16x16", "--frames", "1", "--json"} +
                                                kHalf,
                                            gpu_kernels())
                                           .out);
        CHECK(bench.at("models").at(0).at("precision") == "float16");
    }
}
