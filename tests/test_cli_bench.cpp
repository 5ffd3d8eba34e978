#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;
using nlohmann::json;

// What is measured is not judged here: a shared machine keeps no times.
namespace {

/// The cheapest operation, and the cheapest model at a small size.
const Arguments kOperation{"bench", "--op", "^fusion_mix$"};
const Arguments kModel{"bench", "--model", "edi", "--size", "48x40", "--frames", "3"};

void check_timed(const json& row) {
    CHECK(row.at("ms").get<double>() > 0);
    CHECK(row.at("spread_ms").get<double>() >= 0);
    CHECK(row.at("quartiles_ms").at(0).get<double>() <= row["ms"].get<double>());
    CHECK(row["quartiles_ms"].at(1).get<double>() >= row["ms"].get<double>());
    CHECK(row.at("runs").get<int>() >= 5);
}

/// A report of the operation, measured once.
const json& report() {
    static const json measured = json::parse(must(kOperation + Arguments{"--json"}).out);
    return measured;
}

std::string saved(const std::string& name, const json& content) {
    return put(Scene::get().folder / name, content.dump()).string();
}

/// The report as if the operation had once taken `factor` times what it takes, three quarters of
/// the runs at most `quartile` times that.
std::string saved_with(const std::string& name, double factor, double quartile) {
    json changed = report();
    json& row = changed["ops"][0];
    row["ms"] = row["ms"].get<double>() * factor;
    row["quartiles_ms"][1] = row["ms"].get<double>() * quartile;
    return saved(name, changed);
}

Arguments against(const std::string& file) {
    return kOperation + Arguments{"--json", "--compare", file};
}

} // namespace

TEST_SUITE("cli bench") {
    TEST_CASE("an operation: its time and share, the roof and the surroundings") {
        for (const char* field : {"device", "driver", "type"}) {
            CAPTURE(field);
            CHECK(!report().at(field).get<std::string>().empty());
        }
        CHECK(report().at("precision") == "float32");
        CHECK(!report().at("host").at("cpu").get<std::string>().empty());
        CHECK(report()["host"].at("cores").get<int>() >= 1);
        CHECK(!report()["host"].at("system").get<std::string>().empty());
        CHECK(report().at("roof").at("gflops").get<double>() > 0);
        CHECK(report()["roof"].at("gbs").get<double>() > 0);
        CHECK(report().at("overhead").at("submit_us").get<double>() > 0);
        CHECK(report()["overhead"].at("dispatch_us").get<double>() > 0);
        CHECK(report().at("models").empty());
        REQUIRE(report().at("ops").size() == 1);
        const json& row = report()["ops"][0];
        CHECK(row.at("ok") == true);
        check_timed(row);
        CHECK(row.at("name") == "fusion_mix");
        CHECK(row.at("shape").get<std::string>().find("60x45") != std::string::npos);
        CHECK(row.at("error").get<double>() < 1e-6);
        const double arithmetic =
            row.at("gflops").get<double>() / report()["roof"]["gflops"].get<double>();
        const double memory = row.at("gbs").get<double>() / report()["roof"]["gbs"].get<double>();
        CHECK(row.at("share").get<double>() == doctest::Approx(std::max(arithmetic, memory)));
    }

    TEST_CASE("a model: its time and, where asked for, its start-up; the same as a table") {
        const json all = json::parse(must(kModel + Arguments{"--start", "--json"}).out);
        CHECK(all.at("ops").empty());
        REQUIRE(all.at("models").size() == 1);
        const json& row = all["models"][0];
        CHECK(row.at("ok") == true);
        check_timed(row);
        check_timed(row.at("stream"));
        CHECK(row.at("name") == "edi");
        CHECK(row.at("size") == "48x40");
        CHECK(row.at("frames") == 3);
        CHECK(row.at("refine") == 0);
        CHECK(row.at("new_size") == "69x57");
        for (const char* time : {"first_run_s", "second_run_s"}) {
            CAPTURE(time);
            CHECK(row.at(time).get<double>() > 0);
        }
        CHECK(row.at("second_start_s").get<double>() <= row["second_run_s"].get<double>());
        CHECK(row.at("new_size_s").get<double>() >= 0);
        // As fast or not: a shared machine keeps no times.
        const json again = json::parse(
            run_ecir(kModel + Arguments{"--json", "--compare", saved("model.json", all)}).out);
        REQUIRE(again.at("compared").size() == 2);
        CHECK(again["compared"][1].at("what") ==
              "edi 48x40, 3 frames, refine 0, float32, in a stream");

        const Outcome table = must(kModel + Arguments{"--op", "^fusion_mix$"});
        for (const char* part :
             {"float32", "GFLOP/s", "a dispatch", "fusion_mix", "edi", "48x40"}) {
            CAPTURE(part);
            CHECK(table.out.find(part) != std::string::npos);
        }
        CHECK(table.err.empty()); // progress is for terminals
    }

    TEST_CASE("the refinement of a model is as trained unless given") {
        const std::string weights =
            std::string(ECIR_TEST_DATA) + "/fixtures/esl-net-41x29.safetensors";
        const Arguments small{"bench", "--model",  weights, "--size",
                              "16x16", "--frames", "1",     "--json"};
        CHECK(json::parse(must(small).out).at("models").at(0).at("refine") == 0);
        const Arguments ecir{"bench", "--model",  "ecir", "--size",
                             "16x16", "--frames", "2",    "--json"};
        const auto refine = [&](const Arguments& more) {
            return json::parse(must(ecir + more).out).at("models").at(0).at("refine").get<int>();
        };
        CHECK(refine({}) == 3);
        CHECK(refine({"--refine", "1"}) == 1);
    }

    TEST_CASE("a comparison is exit 1 where a row takes longer beyond the noise") {
        const std::string fast = saved_with("fast.json", 1e-3, 1);
        must_fail(1, against(fast), {"1 of 1 rows", "fast.json", "fusion_mix"});
        // As much slower, but the old runs took as long now and then.
        const json within = json::parse(must(against(saved_with("wide.json", 1e-3, 1e6))).out);
        CHECK(within.at("compared").at(0).at("regression") == false);
        CHECK(within["compared"][0].at("ratio").get<double>() > 10);
        const Outcome faster =
            must(kOperation + Arguments{"--compare", saved_with("slow.json", 1e3, 1)});
        CHECK(faster.out.find("slow.json") != std::string::npos);
        CHECK(faster.out.find("SLOWER") == std::string::npos);
    }

    TEST_CASE("a comparison needs a report with the same rows") {
        must_fail(3, against("nosuch.json"), {"nosuch.json"});
        must_fail(3, {"bench", "-m", "nothing"}, {"no model 'nothing'"});
        must_fail(3, against(put(Scene::get().folder / "text.json", "no").string()),
                  {"text.json", "not a report of ecir bench"});
        must_fail(3, against(saved("none.json", {{"device", "x"}, {"ops", json::array()}})),
                  {"none.json", "models"});
        must_fail(3, against(saved_with("zero.json", 0, 1)), {"zero.json", "above 0"});
        json other = report();
        other["ops"][0]["shape"] = "another";
        other["device"] = "another device";
        must_fail(3, against(saved("other.json", other)), {"other.json", "none of"});
    }

    TEST_CASE("wrong usage") {
        must_fail(2, {"bench", "--op", "("}, {"'('", "regular expression"});
        must_fail(2, {"bench", "--op", "no such operation"}, {"'no such operation'"});
        must_fail(2, kOperation + Arguments{"--size", "48x40"}, {"--model"});
        must_fail(2, kOperation + Arguments{"--start"}, {"--model"});
        must_fail(2, {"bench", "--refine", "3"}, {"--model"});
        must_fail(2, kModel + Arguments{"--refine", "3"}, {"edi", "--refine"});
        must_fail(2, {"bench", "--model", "edi", "--size", "big"}, {"'big'"});
        must_fail(2, {"bench", "--model", "edi", "--frames", "0"}, {"--frames"});
        must_fail(3, {"bench", "--model", "nosuch"}, {"'nosuch'", "fusion"});
        must_fail(4, kOperation + Arguments{"-g", "no such device"}, {"'no such device'"});
    }

    TEST_CASE("deblur says that it compiles, the first time") {
        const Scene& scene = Scene::get();
        Surroundings fresh;
        fresh.environment = {{"ECIR_CACHE_DIR", (scene.folder / "cache").string()}};
        const auto told = [&](const std::string& out) {
            const Arguments model{"-m", "fusion", "--threshold", "0.2", "--times", "0"};
            return must(scene.deblur(scene.result(out), model), fresh).err.find("compiling") !=
                   std::string::npos;
        };
        CHECK(told("compiled"));
        CHECK(!told("compiled-before"));
    }

    TEST_CASE("the choice of kernels is explained, and follows what the environment asks for") {
        const Outcome here = must({"bench", "--explain"});
        CHECK(here.out.find("conv_") != std::string::npos);
        Surroundings tiles;
        tiles.environment = {{"ECIR_CONV", "tile"}};
        const Outcome there = must({"bench", "--explain"}, tiles);
        CHECK(there.out.find("tile (shaders/conv_tile.comp) for all") != std::string::npos);
        CHECK(there.out.find("ECIR_CONV: tile") != std::string::npos);
    }
}
