#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;
using nlohmann::json;

TEST_SUITE("cli program") {
    TEST_CASE("help is exit 0 and shows examples") {
        const Outcome all = must({"--help"});
        for (const std::string command :
             {"deblur", "simulate", "eval", "verify", "bench", "info", "devices"}) {
            CAPTURE(command);
            CHECK(all.out.find(command) != std::string::npos);
            const Outcome one = must({command, "--help"});
            CHECK(one.out.find("ecir " + command) != std::string::npos);
            CHECK(one.out.find("Example") != std::string::npos);
            CHECK(one.err.empty());
        }
        CHECK(must({"--version"}).out.starts_with("ecir "));
    }

    TEST_CASE("wrong usage is exit 2") {
        const Outcome none = run_ecir({});
        CHECK(none.code == 2);
        CHECK(none.err.find("deblur") != std::string::npos); // the help
        must_fail(2, {"nosuch"}, {"'nosuch'", "ecir --help"});
        must_fail(2, {"deblur"}, {"ecir deblur --help"});
        must_fail(2, {"devices", "--bogus"}, {"--bogus", "ecir devices --help"});
        const Scene& scene = Scene::get();
        must_fail(2, scene.deblur(scene.result("no"), {"--bogus"}), {"--bogus"});
        CHECK(!fs::exists(scene.result("no")));
    }

    TEST_CASE("a full standard output is exit 5") {
        Surroundings full;
        full.full_output = true;
        must_fail(5, {"devices", "--json"}, {"standard output"}, full);
        must_fail(5, {"--help"}, {"standard output"}, full);
    }

    TEST_CASE("devices: one of them is the default") {
        const json devices = json::parse(must({"devices", "--json"}).out);
        REQUIRE(devices.is_array());
        int defaults = 0;
        for (size_t i = 0; i < devices.size(); ++i) {
            CHECK(devices[i].at("index") == i);
            CHECK(devices[i].at("name").is_string());
            CHECK(devices[i].at("type").is_string());
            CHECK(devices[i].at("driver").is_string());
            defaults += devices[i].at("default").get<bool>() ? 1 : 0;
        }
        CHECK(defaults == 1);
        const std::string table = must({"devices"}).out;
        CHECK(table.find(devices[0]["name"].get<std::string>()) != std::string::npos);
        CHECK(table.find("default: ") != std::string::npos); // and why
    }

    TEST_CASE("verify: the operations asked for, with error and tolerance") {
        const json report = json::parse(must({"verify", "--op", "^keypoints$", "--json"}).out);
        CHECK(report.at("device").is_string());
        REQUIRE(!report.at("ops").empty());
        for (const json& op : report["ops"]) {
            CHECK(op.at("name") == "keypoints");
            CHECK(op.at("shape").is_string());
            CHECK(op.at("error").is_number());
            CHECK(op.at("tolerance").is_number());
            CHECK(op.at("ok") == true);
        }
        CHECK(must({"verify", "--op", "keypoints"}).out.find("within tolerance") !=
              std::string::npos);
        must_fail(2, {"verify", "--op", "no such operation"}, {"'no such operation'"});
        must_fail(2, {"verify", "--op", "("}, {"'('", "regular expression"});
        must_fail(4, {"verify", "-g", "no such device"}, {"'no such device'"});
    }

    TEST_CASE("eval: figures of a chain simulate, deblur, eval") {
        const Scene& scene = Scene::get();
        const std::string truth = (scene.grey / "truth").string();
        const std::string array = (scene.grey / "truth.npy").string();
        must(scene.deblur(scene.result("sharp"), kEdi));
        must(scene.deblur(scene.result("sharp.npy"), kEdi));
        const auto eval = [](const std::string& t, const std::string& p,
                             const Arguments& more = {}) {
            return Arguments{"eval", "--truth", t, "--prediction", p} + more;
        };
        const json report = json::parse(must(eval(truth, scene.result("sharp"), {"--json"})).out);
        CHECK(report.at("psnr").get<double>() > 20);
        CHECK(report.at("ssim").get<double>() > 0.7);
        CHECK(report.at("nrmse").get<double>() < 0.2);
        // Better than what went in.
        must(Arguments{"deblur", "-i", scene.blurry.string(), "-e", scene.events.string(),
                       "--exposure", std::to_string(kStart), std::to_string(kEnd), "-o",
                       scene.result("blurry"), "-m", "edi", "--threshold", "0.001"});
        const json before = json::parse(must(eval(truth, scene.result("blurry"), {"--json"})).out);
        CHECK(report["psnr"].get<double>() > before["psnr"].get<double>());
        const json arrays =
            json::parse(must(eval(array, scene.result("sharp.npy"), {"--json"})).out);
        CHECK(arrays["psnr"].get<double>() ==
              doctest::Approx(report["psnr"].get<double>()).epsilon(0.02));
        CHECK(must(eval(truth, scene.result("sharp"))).out.find("psnr") != std::string::npos);

        const Outcome same = must(eval(truth, truth, {"--json", "--min-psnr", "90"}));
        CHECK(json::parse(same.out).at("psnr").is_null());
        CHECK(json::parse(same.out).at("nrmse") == 0.0);
        CHECK(json::parse(same.out).at("ssim") == doctest::Approx(1));
        CHECK(same.err.find("identical") != std::string::npos);
        CHECK(must(eval(array, array)).out.find("infinite") != std::string::npos);

        must_fail(1, eval(truth, scene.result("sharp"), {"--min-psnr", "90"}), {"90.00 dB"});
        must(eval(truth, scene.result("sharp"), {"--min-psnr", "10"}));
        must_fail(2, eval(truth, scene.result("sharp"), {"--min-psnr", "nan"}), {"--min-psnr"});
        must_fail(3, eval(truth, scene.result("nosuch")), {"nosuch"});
        must(scene.deblur(scene.result("short"), kEdi + Arguments{"--frames", "3"}));
        must_fail(3, eval(truth, scene.result("short")), {"14 frames", "3"});
        must(scene.deblur(scene.result("little"), kEdi + Arguments{"--size", "24x20"}));
        must_fail(3, eval(truth, scene.result("little")), {"48x40", "24x20"});
        must_fail(3, eval(array, put(scene.folder / "bad.npy", "x").string()), {"bad.npy"});
    }

    TEST_CASE("simulate: a still must be an image, the output new") {
        const Scene& scene = Scene::get();
        must_fail(3, {"simulate", "-i", "nosuch.png", "-o", scene.result("no")}, {"nosuch.png"});
        must_fail(
            2, {"simulate", "-i", (scene.folder / "still.png").string(), "-o", scene.grey.string()},
            {"grey", "--overwrite"});
        CHECK(!fs::exists(scene.result("no")));
    }
}
