#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;
using nlohmann::json;

TEST_SUITE("cli stability") {
    TEST_CASE("a sweep gives a table, JSON and a chart, and the list names it") {
        const Scene& scene = Scene::get();
        const std::string out = scene.result("stability");
        const json report = json::parse(
            must({"stability", "--sweep", "^refine-descent$|motion-travel", "--quick", "-m", "edi",
                  "--images", (scene.folder / "still.png").string(), "-o", out, "--json"})
                .out);
        CHECK(report.at("size") == "48x40");
        REQUIRE(report.at("sweeps").size() == 2);
        const json& travel = report["sweeps"][0];
        CHECK(travel.at("name") == "motion-travel");
        CHECK(travel.at("series")[0].at("name") == "blurry frame");
        CHECK(travel.at("series")[2].at("name") == "edi");
        // A scene at rest has no events, so the frames are the blurry one.
        CHECK(travel["series"][0]["values"][0] == travel["series"][2]["values"][0]);
        CHECK(travel["series"][2]["values"][1].get<double>() >
              travel["series"][0]["values"][1].get<double>());
        CHECK(report["sweeps"][1]["series"][1]["fails_at"] == "0.4");
        CHECK(names(out) == std::vector<std::string>{"README.md", "motion-travel.svg",
                                                     "refine-descent.svg", "stability.json"});
        CHECK(json::parse(get(fs::path(out) / "stability.json")) == report);
        CHECK(must({"stability", "--list"}).out.find("motion-travel ") != std::string::npos);
    }

    TEST_CASE("what cannot be swept is refused") {
        must_fail(2, {"stability", "--sweep", "nothing-like-it"}, {"nothing-like-it", "--list"});
        must_fail(2, {"stability", "--sweep", "("}, {"regular expression"});
        must_fail(3, {"stability", "--images", "/no/such.png"}, {"/no/such.png"});
        must_fail(3, {"stability", "-m", "nothing"}, {"no model 'nothing'"});
    }
}
