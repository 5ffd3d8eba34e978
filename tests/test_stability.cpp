#include <cmath>
#include <doctest/doctest.h>
#include <nlohmann/json.hpp>
#include <numeric>

#include "layers/curve.hpp"
#include "layers/reference/curve.hpp"
#include "tests/cli_support.hpp"
#include "tools/stability/frames.hpp"
#include "tools/stability/interpolation.hpp"
#include "tools/stability/run.hpp"
#include "tools/stability/stages.hpp"
#include "tools/stability/weights_copy.hpp"

using namespace ecir;
using namespace ecir::stability;
namespace fs = std::filesystem;

namespace {

Subject small_subject() {
    Subject subject;
    subject.picture = test::still(1);
    subject.width = test::kWidth;
    subject.height = test::kHeight;
    subject.frames = 3;
    return subject;
}

/// Every sweep on small frames with all that ships.
const Lab& small_lab() {
    static const Lab lab = [] {
        Lab made;
        made.device = Device::open();
        made.methods = methods_of(model_names());
        made.subjects = {small_subject()};
        return made;
    }();
    return lab;
}

/// The safe behaviour of each sweep of a group.
void hold(const std::vector<Sweep>& sweeps) {
    for (const Sweep& sweep : sweeps) {
        CAPTURE(sweep.name);
        CHECK_FALSE(sweep.promises.empty());
        CHECK_FALSE(sweep.fails.empty());
        CHECK_FALSE(sweep.safe.empty());
        CHECK((sweep.labels.empty() || sweep.labels.size() == sweep.values.size()));
        const Result result = run(sweep, small_lab(), true, [](size_t) {});
        for (const std::string& sentence : result.broken()) {
            FAIL_CHECK(sentence);
        }
        CHECK(result.samples.size() == sweep.quick.size());
        CHECK_FALSE(result.series().empty());
    }
}

Sample sample(const std::string& series, double value, bool failed = false) {
    Sample made{.series = series, .value = value, .failed = failed};
    made.how = failed ? "off by " + std::to_string(static_cast<int>(value)) : "";
    return made;
}

Result result_of(std::vector<double> values, const std::vector<bool>& failed) {
    Result result;
    result.sweep.name = "made-up";
    result.sweep.title = "A & B";
    result.sweep.x.label = "x, px";
    result.sweep.y.label = "y, dB";
    result.sweep.limit = 2;
    result.sweep.values = result.values = std::move(values);
    for (size_t i = 0; i < failed.size(); ++i) {
        result.samples.push_back({sample("method", static_cast<double>(i), failed[i])});
        result.samples.back().push_back(sample("input", 1));
        result.samples.back().back().reference = true;
    }
    return result;
}

} // namespace

TEST_SUITE("stability") {
    TEST_CASE("events: as safe as promised") {
        hold(event_sweeps());
    }
    TEST_CASE("sensor: as safe as promised") {
        hold(sensor_sweeps());
    }
    TEST_CASE("motion: as safe as promised") {
        hold(motion_sweeps());
    }
    TEST_CASE("light: as safe as promised") {
        hold(light_sweeps());
    }
    TEST_CASE("curve: as safe as promised") {
        hold(curve_sweeps());
    }
    TEST_CASE("refinement: as safe as promised") {
        hold(refinement_sweeps());
    }
    TEST_CASE("precision: as safe as promised") {
        hold(precision_sweeps());
    }

    TEST_CASE("no two sweeps share a name") {
        std::vector<std::string> names;
        for (const Sweep& sweep : all_sweeps()) {
            names.push_back(sweep.name);
        }
        std::ranges::sort(names);
        CHECK(std::ranges::adjacent_find(names) == names.end());
    }

    TEST_CASE("a promise is broken by failing within it, and by what is not finite anywhere") {
        Sweep sweep{.name = "s", .title = "t", .x = {"x"}};
        sweep.promises = {{"a", 1, 2}};
        CHECK_FALSE(sweep.holds(sample("a", 0, true), 2));
        CHECK(sweep.holds(sample("a", 0, false), 2));
        CHECK(sweep.holds(sample("a", 0, true), 2.1));
        CHECK(sweep.holds(sample("b", 0, true), 2));
        Sample broken = sample("b", std::nan(""), true);
        broken.finite = false;
        CHECK_FALSE(sweep.holds(broken, 5));
    }

    TEST_CASE("where a series fails, in words") {
        const std::vector<double> values = {1, 2, 4, 8};
        const auto at = [&](const std::vector<bool>& failed) {
            return failure(result_of(values, failed), "method").at;
        };
        CHECK(at({false, false, false, false}) == "nowhere");
        CHECK(at({true, true, true, true}) == "all values");
        CHECK(at({false, false, true, true}) == "4 to 8");
        CHECK(at({true, false, true, false}) == "1; 4");
        CHECK(failure(result_of(values, {false, false, true, true}), "method").how == "off by 3");
    }

    TEST_CASE("chart, table and JSON of a result") {
        const Result result = result_of({1, 2, 4, 8}, {false, true, false, true});
        const std::string chart = line_chart(result, "below");
        const auto count = [](const std::string& text, const std::string& part) {
            size_t found = 0;
            for (size_t at = text.find(part); at != std::string::npos;
                 at = text.find(part, at + 1)) {
                ++found;
            }
            return found;
        };
        CHECK(count(chart, "A &amp; B") == 1);
        CHECK(count(chart, "x, px") == 1);
        CHECK(count(chart, "y, dB") == 1);
        CHECK(count(chart, "fails above") == 1);
        CHECK(count(chart, "<polyline") == 2);
        CHECK(count(chart, "<circle") == 2 + 1); // what does not fail, and the legend
        CHECK(count(chart, "nan") + count(chart, "inf") == 0);
        const std::string table = markdown({result}, "here");
        CHECK(count(table, "| method | 2; 8 | off by 3 |  |") == 1);
        CHECK(count(table, "| input |") == 0);
        const auto json = to_json(result);
        CHECK(json.at("series").size() == 2);
        CHECK(json["series"][0]["fails_at"] == "2; 8");
        CHECK(json["series"][0]["values"] == nlohmann::json{0, 1, 2, 3});
        CHECK(json["series"][1]["reference"] == true);
    }

    TEST_CASE("a capture's truth has the blurry frame as its mean, light and disc included") {
        Subject subject = small_subject();
        subject.frames = 201;
        Setting setting = nominal(subject);
        setting.light = [](double time) { return 1 - 0.5 * time; };
        setting.disc = Disc{.radius_px = 6, .centre = [](double time) {
                                return std::array<double, 2>{10 * time, 0.0};
                            }};
        setting.bits = 16;
        const Capture made = capture(subject, setting);
        std::vector<float> mean(made.pixels());
        for (size_t i = 0; i < made.truth.size(); ++i) {
            const float share = i == 0 || i + 1 == made.truth.size() ? 0.5F : 1.0F;
            for (size_t p = 0; p < mean.size(); ++p) {
                mean[p] += share * made.truth[i][p] / 200;
            }
        }
        CHECK(rms_levels(mean, made.blurry) < 0.1);
        CHECK(psnr(made.truth.front(),
                   Capture{made.width, made.height, {}, {}, {}, {made.truth.front()}, {}}) ==
              doctest::Approx(58.92).epsilon(1e-3));
    }

    TEST_CASE("events before the exposure come along when asked for, and moving keeps order") {
        const Subject subject = small_subject();
        Setting setting = nominal(subject);
        setting.before = true;
        const Capture made = capture(subject, setting);
        CHECK(made.exposure.start == setting.exposure_us);
        CHECK(made.events.t.front() < made.exposure.start);
        CHECK(made.events.t.back() > made.exposure.start);
        const Events folded = retimed(made.events, [](int64_t time) { return time % 1000; });
        CHECK(folded.size() == made.events.size());
        CHECK(std::ranges::is_sorted(folded.t));
    }

    TEST_CASE("what fails within a promise is safe where every scene of it is warned of") {
        Sweep sweep{.name = "s", .title = "S", .x = {"x"}};
        sweep.promises = {{"", 0, 10}};
        Sample sample{.series = "method", .value = 3, .failed = true, .how = "off"};
        CHECK_FALSE(sweep.holds(sample, 1));
        CHECK(sweep.holds(sample, 11));
        sample.warned.emplace();
        CHECK_FALSE(sweep.holds(sample, 1));
        Result result{sweep, {1, 2, 3}, {{sample}, {sample}, {sample}}};
        CHECK(failure(result, "method").warned == "nothing at 1, 2, 3");
        sample.warned = {"slow"};
        CHECK_FALSE(sweep.holds(sample, 1)); // of something else
        sweep.warnings = {"fast", "slow"};
        CHECK(sweep.holds(sample, 1));
        result.samples[1] = result.samples[2] = {sample};
        CHECK(failure(result, "method").warned == "slow; nothing at 1");
        sample.finite = false;
        CHECK_FALSE(sweep.holds(sample, 1));
    }

    TEST_CASE("every form of the curve is the exact one where n is small and keypoints are even") {
        const Knots knots{{-1, -0.3F, 0.4F, 1}, {1, -2, 0.5F, 3}};
        const std::vector<float> times = {-1, -0.6F, 0, 0.3F, 1};
        for (const Form form : {monomial_derivative, barycentric_derivative, newton_derivative,
                                legendre_derivative, lagrange_derivative}) {
            const auto values = form(knots, times);
            for (size_t i = 0; i < times.size(); ++i) {
                CHECK(values[i] ==
                      doctest::Approx(exact_derivative(knots, times[i])).epsilon(1e-5));
            }
        }
        for (const Form form : {monomial_curve, barycentric_curve, newton_curve, legendre_curve}) {
            const auto values = form(knots, times);
            for (size_t i = 0; i < times.size(); ++i) {
                CHECK(std::abs(values[i] - reference::curve(knots.t, knots.y, 0, times[i])) < 1e-5);
            }
        }
        // Two keypoints at the ends: |l_0| + |l_1| = 1; so the curve moves by at most 1.
        const std::vector<float> ends = {-1, 1};
        CHECK(lebesgue_constant(ends) == doctest::Approx(1));
        CHECK(curve_amplification(ends) == doctest::Approx(1));
    }

    TEST_CASE("rounding to half precision: every float16 is itself, ties go to even") {
        for (uint32_t bits = 0; bits < 0x7C00; ++bits) {
            const float value = half_to_float(static_cast<uint16_t>(bits));
            CHECK(rounded_to_half(value) == value);
            const float next = half_to_float(static_cast<uint16_t>(bits + 1));
            if (bits + 1 < 0x7C00) {
                const float middle = value + (next - value) / 2;
                CHECK(rounded_to_half(middle) == (bits % 2 == 0 ? value : next));
            }
        }
        CHECK(rounded_to_half(-0.1F) == -rounded_to_half(0.1F));
        CHECK(rounded_to_half(65519) == 65504);
        CHECK(std::isinf(rounded_to_half(65520)));
    }

    TEST_CASE("in steps and all at once E-CIR and EDI give the same frames") {
        const Subject subject = small_subject();
        const Capture made = capture(subject, nominal(subject));
        const auto times = even_times(subject.frames);
        const FrameInput input{made.blurry, made.events.view(), made.exposure, times};
        const SafeTensors weights(find_model("ecir"));
        const StagedFrames staged =
            StagedEcir(*small_lab().device, weights, made.width, made.height)
                .frames(input, Border::none);
        stability::Method method;
        method.options.model = "ecir";
        CHECK(staged.refined == find_frames(small_lab(), method, made).frames);
        method.options.refine = 0;
        CHECK(staged.curve == find_frames(small_lab(), method, made).frames);

        const EdiThresholds thresholds{0.2F, 0.2F};
        Capture told = made;
        told.told = thresholds;
        method = {"edi", {}, true};
        method.options.model = "edi";
        const auto edi = staged_edi(input, made.width, made.height, thresholds, EdiBorder::none);
        CHECK(rms_levels(edi, find_frames(small_lab(), method, told).frames) < 1e-3);
    }

    TEST_CASE("a copy of weights has what was changed, and goes away") {
        const SafeTensors weights(find_model("ecir"));
        fs::path path;
        {
            const WeightsCopy copy(weights, [](const std::string& name, float value) {
                return name == "refine.alpha_net.bias" ? 2 * value : value;
            });
            path = copy.path();
            const SafeTensors read(path);
            CHECK(read.metadata() == weights.metadata());
            CHECK(read.get("refine.alpha_net.bias").values.front() ==
                  2 * weights.get("refine.alpha_net.bias").values.front());
            CHECK(read.get("unet.en_conv1.0.weight").values ==
                  weights.get("unet.en_conv1.0.weight").values);
        }
        CHECK_FALSE(fs::exists(path));
    }
}
