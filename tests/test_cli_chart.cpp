#include <cmath>
#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "tests/cli_support.hpp"
#include "tools/ecir/chart_point.hpp"
#include "tools/ecir/chart_svg.hpp"

using namespace ecir;
using namespace ecir::test;
using cli::ChartPoint;
using nlohmann::json;

namespace {

ChartPoint point(const std::string& model, double ms, double psnr) {
    ChartPoint made;
    made.model = model;
    made.ms = ms;
    made.gflop = ms;
    made.psnr = psnr;
    made.ssim = psnr / 50;
    return made;
}

size_t count(const std::string& text, const std::string& part) {
    size_t found = 0;
    for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) {
        ++found;
    }
    return found;
}

} // namespace

TEST_SUITE("cli chart") {
    TEST_CASE("the Pareto front: what nothing cheaper or equal in cost beats") {
        const std::vector<ChartPoint> points = {point("slow", 9, 30), point("good", 5, 30),
                                                point("fast", 1, 20), point("bad", 2, 19),
                                                point("twin", 1, 20), point("best", 20, 31)};
        const std::vector<bool> expected = {false, true, true, false, true, true};
        CHECK(cli::pareto_front(points, &ChartPoint::ms, &ChartPoint::psnr) == expected);
    }

    TEST_CASE("the drawing has a mark for each point in each panel, and names with &, < escaped") {
        const std::vector<ChartPoint> points = {point("a&b", 1, 20), point("c<d", 10, 30)};
        const std::string svg = cli::chart_svg(points, "title", "below");
        CHECK(count(svg, "<circle") == 4 * points.size());
        CHECK(count(svg, "<polyline") == 4);
        CHECK(count(svg, "a&amp;b") == 4);
        CHECK(count(svg, "c&lt;d") == 4);
        CHECK(count(svg, "nan") + count(svg, "inf") == 0);
        const std::vector<ChartPoint> one = {point("alone", 3, 25)};
        CHECK(count(cli::chart_svg(one, "title", "below"), "nan") == 0);
    }

    TEST_CASE("a scene with edi: the same accuracy as deblur and eval find, and three files") {
        const Scene& scene = Scene::get();
        const std::string out = scene.result("chart");
        const json report = json::parse(
            must({"chart", "--scenes", scene.grey.string(), "-m", "edi", "-o", out, "--json"}).out);
        CHECK(report.at("size") == "48x40");
        CHECK(report.at("scenes") == 1);
        const json& points = report.at("points");
        REQUIRE(points.size() == 2);
        CHECK(points[0].at("scale") == 1);
        CHECK(points[1].at("scale") == 0.5);
        for (const json& each : points) {
            CHECK(each.at("ms").get<double>() > 0);
            CHECK(each.at("gflop").get<double>() > 0);
        }
        CHECK(points[0]["gflop"].get<double>() > points[1]["gflop"].get<double>());

        const std::string sharp = scene.result("chart-edi.npy");
        must({"deblur", "-i", scene.grey.string(), "-o", sharp, "-m", "edi", "--frames",
              std::to_string(report.at("frames").get<int>())});
        const json same = json::parse(must({"eval", "--truth", (scene.grey / "truth").string(),
                                            "--prediction", sharp, "--json"})
                                          .out);
        CHECK(points[0].at("psnr").get<double>() ==
              doctest::Approx(same.at("psnr").get<double>()).epsilon(1e-6));
        CHECK(points[0].at("ssim").get<double>() ==
              doctest::Approx(same.at("ssim").get<double>()).epsilon(1e-6));

        CHECK(names(out) == std::vector<std::string>{"chart.csv", "chart.json", "chart.svg"});
        CHECK(json::parse(get(fs::path(out) / "chart.json")) == report);
        CHECK(lines(fs::path(out) / "chart.csv").size() == 3);
    }

    TEST_CASE("auto at each quality, which computes what moves: as deblur finds") {
        const Scene& scene = Scene::get();
        const json points =
            json::parse(
                must({"chart", "--scenes", scene.grey.string(), "-m", "auto", "--json"}).out)
                .at("points");
        REQUIRE(points.size() == 6);
        const std::vector<std::string> expected = {"auto, fast", "auto, balanced", "auto, best"};
        for (size_t i = 0; i < expected.size(); ++i) {
            CHECK(points[i].at("name") == expected[i]);
            CHECK(points[i].at("ms_most") == points[i].at("ms")); // the only scene
        }
        const std::string sharp = scene.result("chart-auto.npy");
        must({"deblur", "-i", scene.grey.string(), "-o", sharp, "--quality", "fast", "--frames",
              std::to_string(names(scene.grey / "truth").size())});
        const json same = json::parse(must({"eval", "--truth", (scene.grey / "truth").string(),
                                            "--prediction", sharp, "--json"})
                                          .out);
        CHECK(points[0].at("psnr").get<double>() ==
              doctest::Approx(same.at("psnr").get<double>()).epsilon(1e-6));
    }

    TEST_CASE("what is not a scene is refused, and nothing is left behind") {
        const Scene& scene = Scene::get();
        const fs::path empty = scene.folder / "empty";
        fs::create_directory(empty);
        const std::string out = scene.result("chart-none");
        must_fail(3, {"chart", "--scenes", empty.string(), "-o", out},
                  {empty.string(), "holds no scenes"});
        const fs::path gap = scene.folder / "gap";
        fs::copy(scene.grey, gap, fs::copy_options::recursive);
        fs::remove(gap / "truth/000003.png");
        must_fail(3, {"chart", "--scenes", gap.string(), "-m", "edi", "-o", out},
                  {"truth/000004.png", "missing"});
        must_fail(3, {"chart", "--scenes", scene.grey.string(), "-m", "nothing", "-o", out},
                  {"no model 'nothing'"});
        CHECK_FALSE(fs::exists(out));
        must_fail(2, {"chart"}, {"--scenes"});
    }
}
