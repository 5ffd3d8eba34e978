#include <doctest/doctest.h>
#include <nlohmann/json.hpp>
#include <opencv2/videoio.hpp>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

io::Array array(const std::string& path) {
    return io::read_npy(path);
}

/// Frame `index` of an array.
std::vector<float> frame(const io::Array& all, size_t index) {
    const size_t size = all.values.size() / all.shape[0];
    const auto first = all.values.begin() + static_cast<std::ptrdiff_t>(index * size);
    return {first, first + static_cast<std::ptrdiff_t>(size)};
}

/// The network's default frames.
const std::string& network_array() {
    static const std::string path = [] {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("network.npy")));
        return scene.result("network.npy");
    }();
    return path;
}

size_t video_frames(const std::string& path, cv::Size& size) {
    cv::VideoCapture video(path);
    cv::Mat image;
    size_t count = 0;
    for (; video.read(image); ++count) {
        size = image.size();
    }
    return count;
}

} // namespace

TEST_SUITE("cli deblur") {
    TEST_CASE("a folder holds numbered PNGs and their times") {
        const Scene& scene = Scene::get();
        const Outcome outcome = must(scene.deblur(scene.result("folder"), kEdi));
        CHECK(outcome.out.empty());
        const auto found = names(scene.result("folder"));
        REQUIRE(found.size() == 15);
        CHECK(found.front() == "000000.png");
        CHECK(found[13] == "000013.png");
        CHECK(found.back() == "frames.csv");
        const auto csv = lines(scene.result("folder") + "/frames.csv");
        REQUIRE(csv.size() == 15);
        CHECK(csv[0] == "file,t_normalised,t_us");
        CHECK(csv[1] == "000000.png,-1,1600000000000000");
        CHECK(csv[14] == "000013.png,1,1600000000050000");
        const io::Image image = io::read_image(scene.result("folder") + "/000007.png");
        CHECK(image.width == kWidth);
        CHECK(image.height == kHeight);
        CHECK(image.channels == 1);
        CHECK(image.bits == 8);
        // Nothing on a terminal's progress line, since this is none.
        CHECK(outcome.err.find('\r') == std::string::npos);
    }

    TEST_CASE("an array is float32, frames x height x width, not clipped, the folder's frames") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("edi.npy"), {"-m", "edi", "--threshold", "0.9"}));
        const io::Array all = array(scene.result("edi.npy"));
        CHECK(all.shape == std::vector<size_t>{14, kHeight, kWidth});
        // So strong a threshold overshoots.
        CHECK(*std::max_element(all.values.begin(), all.values.end()) > 1.0F);
        must(scene.deblur(scene.result("edi-folder"), {"-m", "edi", "--threshold", "0.9"}));
        const auto values = frame(all, 3);
        const io::Image image = io::read_image(scene.result("edi-folder") + "/000003.png");
        double worst = 0;
        for (size_t i = 0; i < values.size(); ++i) {
            const double clipped = std::clamp(static_cast<double>(values[i]), 0.0, 1.0);
            worst = std::max(worst, std::abs(clipped - static_cast<double>(image.pixels[i])));
        }
        CHECK(worst <= 0.5001 / 255);
    }

    TEST_CASE("16 bits in are 16 bits out") {
        const Scene& scene = Scene::get();
        io::Image image = io::read_image(scene.blurry);
        image.bits = 16;
        for (float& value : image.pixels) {
            value += 0.3F / 255; // what 8 bits cannot hold
        }
        io::write_image(scene.folder / "deep.png", image);
        const auto arguments =
            Scene::deblur_of(scene.folder / "deep.png", scene.events, scene.result("deep"),
                             kEdi + Arguments{"--frames", "2"});
        must(arguments);
        CHECK(io::read_image(scene.result("deep") + "/000001.png").bits == 16);
    }

    TEST_CASE("videos of every kind hold every frame, also a single one") {
        const Scene& scene = Scene::get();
        for (const std::string name : {"video.mp4", "video.mkv", "video.avi"}) {
            CAPTURE(name);
            must(scene.deblur(scene.result(name), kEdi));
            cv::Size size;
            CHECK(video_frames(scene.result(name), size) == 14);
            CHECK(size == cv::Size(kWidth, kHeight));
        }
        must(scene.deblur(scene.result("one.mp4"), kEdi + Arguments{"--frames", "1"}));
        cv::Size size;
        CHECK(video_frames(scene.result("one.mp4"), size) == 1);
    }

    TEST_CASE("--frames 1 is the middle of the exposure") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("one.npy"), kEdi + Arguments{"--frames", "1"}));
        must(scene.deblur(scene.result("zero"), kEdi + Arguments{"--times", "0"}));
        must(scene.deblur(scene.result("zero.npy"), kEdi + Arguments{"--times", "0"}));
        CHECK(array(scene.result("one.npy")).shape == std::vector<size_t>{1, kHeight, kWidth});
        CHECK(array(scene.result("one.npy")).values == array(scene.result("zero.npy")).values);
        CHECK(lines(scene.result("zero") + "/frames.csv").at(1) == "000000.png,0,1600000000025000");
    }

    TEST_CASE("--fps counts frames a second of the exposure") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("fps"), kEdi + Arguments{"--fps", "100"}));
        const auto csv = lines(scene.result("fps") + "/frames.csv");
        REQUIRE(csv.size() == 7); // 50 ms: 0, 10, ..., 50
        CHECK(csv[1] == "000000.png,-1,1600000000000000");
        CHECK(csv[2].ends_with(",1600000000010000"));
        CHECK(csv[6] == "000005.png,1,1600000000050000");
        must(scene.deblur(scene.result("fps2"), kEdi + Arguments{"--fps", "30"}));
        CHECK(lines(scene.result("fps2") + "/frames.csv").size() == 3);
    }

    TEST_CASE("--times are written in the order given, negative ones and equal ones too") {
        const Scene& scene = Scene::get();
        const Arguments given{"--times", "0.5", "-1", "1", "-.25", "-1e-3", "0.5"};
        for (const Arguments& method : {kEdi, Arguments{}}) {
            CAPTURE(joined(method));
            const std::string name = method.empty() ? "network-" : "edi-";
            must(scene.deblur(scene.result(name + "given.npy"), method + given));
            must(scene.deblur(
                scene.result(name + "sorted.npy"),
                method + Arguments{"--times", "-1", "-0.25", "-0.001", "0.5", "0.5", "1"}));
            const io::Array mixed = array(scene.result(name + "given.npy"));
            const io::Array sorted = array(scene.result(name + "sorted.npy"));
            const std::vector<size_t> place{3, 0, 5, 1, 2, 4};
            for (size_t i = 0; i < place.size(); ++i) {
                CAPTURE(i);
                CHECK(frame(mixed, i) == frame(sorted, place[i]));
            }
        }
        must(scene.deblur(scene.result("given"), kEdi + given));
        const auto csv = lines(scene.result("given") + "/frames.csv");
        REQUIRE(csv.size() == 7);
        CHECK(csv[1] == "000000.png,0.5,1600000000037500");
        CHECK(csv[2] == "000001.png,-1,1600000000000000");
    }

    TEST_CASE("--size sets the output's size") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("small.npy"),
                          kEdi + Arguments{"--size", "24x20", "--frames", "3"}));
        CHECK(array(scene.result("small.npy")).shape == std::vector<size_t>{3, 20, 24});
        must(scene.deblur(scene.result("odd.npy"), {"--size", "31x23", "--frames", "2"}));
        CHECK(array(scene.result("odd.npy")).shape == std::vector<size_t>{2, 23, 31});
        // At no threshold to speak of the frames are the averaged image.
        must(scene.deblur(scene.result("area.npy"), {"-m", "edi", "--threshold", "0.001", "--size",
                                                     "24x20", "--frames", "1"}));
        const io::Image image = io::read_image(scene.blurry);
        const auto values = array(scene.result("area.npy")).values;
        const auto at = [&](size_t x, size_t y) { return image.pixels[y * kWidth + x]; };
        const float mean = (at(10, 8) + at(11, 8) + at(10, 9) + at(11, 9)) / 4;
        CHECK(std::abs(values[4 * 24 + 5] - mean) < 0.01F);
        must_fail(2, scene.deblur(scene.result("no.npy"), {"--size", "24"}),
                  {"--size '24'", "WIDTHxHEIGHT"});
    }

    TEST_CASE("--refine 0 leaves the polish out") {
        const Scene& scene = Scene::get();
        for (const std::string model : {"ecir", "fusion"}) {
            CAPTURE(model);
            const std::string raw = scene.result(model + "-raw.npy");
            const std::string whole = scene.result(model + "-whole.npy");
            must(scene.deblur(raw, {"-m", model, "--refine", "0"}));
            must(scene.deblur(whole, {"-m", model}));
            const double change = rms_difference(array(whole).values, array(raw).values);
            CHECK(change > 1e-4);
            CHECK(change < 0.2);
        }
    }

    TEST_CASE("the same input gives the same bits") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("again.npy")));
        CHECK(get(scene.result("again.npy")) == get(network_array()));
        must(scene.deblur(scene.result("again")));
        must(scene.deblur(scene.result("again2")));
        for (const std::string& name : names(scene.result("again"))) {
            CHECK(get(scene.result("again/" + name)) == get(scene.result("again2/" + name)));
        }
    }

    TEST_CASE("a model is a shipped name from any working folder, a path, or edi") {
        const Scene& scene = Scene::get();
        const std::string file = std::string(ECIR_TEST_DATA) + "/../weights/fusion.safetensors";
        must(scene.deblur(scene.result("path.npy"), {"-m", file}));
        CHECK(get(scene.result("path.npy")) == get(network_array()));
        Surroundings elsewhere;
        elsewhere.folder = "/";
        must(scene.deblur(scene.result("root.npy"), {"-m", "fusion"}), elsewhere);
        CHECK(get(scene.result("root.npy")) == get(network_array()));
        must_fail(3, scene.deblur(scene.result("no.npy"), {"-m", "nosuch"}),
                  {"'nosuch'", "edi, ecir, fusion"});
        must_fail(3, scene.deblur(scene.result("no.npy"), {"-m", "nosuch.safetensors"}),
                  {"nosuch.safetensors"});
    }

    TEST_CASE("edi estimates the thresholds and says them") {
        const Scene& scene = Scene::get();
        const Outcome outcome = must(scene.deblur(scene.result("guess.npy"), {"-m", "edi"}));
        CHECK(outcome.err.find("estimated thresholds 0.") != std::string::npos);
        must(scene.deblur(scene.result("both.npy"), {"-m", "edi", "--threshold", "0.2", "0.25"}));
        must(scene.deblur(scene.result("same.npy"), {"-m", "edi", "--threshold", "0.2", "0.2"}));
        must(scene.deblur(scene.result("single.npy"), kEdi));
        CHECK(get(scene.result("same.npy")) == get(scene.result("single.npy")));
        CHECK(get(scene.result("both.npy")) != get(scene.result("single.npy")));
    }

    TEST_CASE("colour follows the luminance") {
        const Scene& scene = Scene::get();
        make_scene(scene.folder / "coloured.png", scene.folder / "colour", 3);
        const fs::path path = scene.folder / "colour/blurry_000000.png";
        const fs::path events = scene.folder / "colour/events.h5";
        const io::Image blurry = io::read_image(path);
        REQUIRE(blurry.channels == 3);
        must(Scene::deblur_of(path, events, scene.result("colour.npy")));
        const io::Array colour = array(scene.result("colour.npy"));
        CHECK(colour.shape == std::vector<size_t>{14, kHeight, kWidth, 3});

        // 16 bits hold Y well enough for the network to give the same L.
        io::Image grey = blurry;
        grey.channels = 1;
        grey.bits = 16;
        grey.pixels.resize(blurry.pixels.size() / 3);
        for (size_t i = 0; i < grey.pixels.size(); ++i) {
            grey.pixels[i] = 0.299F * blurry.pixels[3 * i] + 0.587F * blurry.pixels[3 * i + 1] +
                             0.114F * blurry.pixels[3 * i + 2];
        }
        io::write_image(scene.folder / "y.png", grey);
        must(Scene::deblur_of(scene.folder / "y.png", events, scene.result("y.npy")));
        const io::Array sharp = array(scene.result("y.npy"));
        const double e = 0.01;
        double worst = 0;
        for (size_t i = 0; i < colour.values.size(); ++i) {
            const size_t pixel = i / 3 % grey.pixels.size();
            const double expected = (blurry.pixels[3 * pixel + i % 3] + e) *
                                        (sharp.values[i / 3] + e) / (grey.pixels[pixel] + e) -
                                    e;
            worst = std::max(worst, std::abs(expected - static_cast<double>(colour.values[i])));
        }
        CHECK(worst < 1e-3);
        must(Scene::deblur_of(path, events, scene.result("colour"),
                              kEdi + Arguments{"--frames", "2"}));
        CHECK(io::read_image(scene.result("colour") + "/000001.png").channels == 3);
        must(Scene::deblur_of(path, events, scene.result("colour.mp4"), kEdi));
    }

    TEST_CASE("a device goes by its index or a part of its name") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("index.npy"), kEdi + Arguments{"-g", "0"}));
        const auto devices = nlohmann::json::parse(must({"devices", "--json"}).out);
        const std::string name = devices[0]["name"];
        must(scene.deblur(scene.result("name.npy"), kEdi + Arguments{"-g", name.substr(1, 4)}));
        CHECK(get(scene.result("index.npy")) == get(scene.result("name.npy")));
        must_fail(4, scene.deblur(scene.result("no.npy"), {"-g", "no such device"}),
                  {"'no such device'", name});
        must_fail(4, scene.deblur(scene.result("no.npy"), {"-g", "77"}), {"'77'"});
    }

    TEST_CASE("a report says what was found and used") {
        const Scene& scene = Scene::get();
        const std::string file = scene.result("report.json");
        must(scene.deblur(scene.result("reported"), Arguments{"--report", file} + kEdi));
        const auto report = nlohmann::json::parse(get(file));
        CHECK(report["device"].is_string());
        CHECK(report["precision"] == "float32");
        REQUIRE(report["exposures"].size() == 1);
        const auto& exposure = report["exposures"][0];
        CHECK(exposure["start_us"] == 1600000000000000);
        CHECK(exposure["end_us"] == 1600000000050000);
        CHECK(exposure["scene"]["events"].get<size_t>() > 0);
        CHECK(exposure["scene"]["travel_px"].get<double>() > 0);
        CHECK(exposure["model"] == "edi");
        CHECK(exposure["frames"] == 14);
        CHECK(exposure["thresholds"]["positive"].get<double>() > 0.03);
        for (const char* stage : {"read", "prepare", "wait", "write"}) {
            CHECK(exposure["ms"][stage].get<double>() > 0);
        }
        const Outcome again =
            run_ecir(scene.deblur(scene.result("reported-2"), Arguments{"--report", file} + kEdi));
        CHECK(again.code == 2); // neither is replaced without being asked to
        CHECK(again.err.find(file) != std::string::npos);
        CHECK_FALSE(fs::exists(scene.result("reported-2")));
    }

    TEST_CASE("a report says how much of E-CIR an exposure took") {
        const Scene& scene = Scene::get();
        const std::string file = scene.result("need.json");
        const auto report_of = [&](const Arguments& more) {
            must(scene.deblur(
                scene.result("need"),
                Arguments{"-m", "ecir", "--frames", "3", "--report", file, "--overwrite"} + more));
            return nlohmann::json::parse(get(file))["exposures"][0];
        };
        const auto all = report_of({"--refine-until", "0"});
        const auto& updates = all["refinement"]["largest_update_levels"][0];
        CHECK(all["refinement"]["iterations"][0] == 3);
        REQUIRE(updates.size() == 3);
        CHECK(updates[0].get<double>() > 0);
        CHECK(all["orders"].is_null());
        const auto one = report_of({"--refine-until", "255", "--order", "events"});
        CHECK(one["refinement"]["iterations"][0] == 1);
        CHECK(one["refinement"]["largest_update_levels"][0].size() == 1);
        CHECK(one["orders"]["pixels"].size() == 11);
        CHECK(one["orders"]["mean"].get<double>() > 0);
        CHECK(one["orders"]["mean"].get<double>() < 10);
        CHECK(report_of({"--refine", "0"})["refinement"].is_null());
        for (const Arguments& option : {Arguments{"--refine-until", "1"}, {"--order", "events"}}) {
            const Outcome refused = run_ecir(scene.deblur(scene.result("x"), kEdi + option));
            CHECK(refused.code == 2);
            CHECK(refused.err.find(option.front()) != std::string::npos);
        }
    }

    TEST_CASE("late events are those of a later exposure") {
        const Scene& scene = Scene::get();
        must(scene.deblur(scene.result("late.npy"), Arguments{"--lag", "700"} + kEdi));
        must(Arguments{"deblur", "-i", scene.blurry, "-e", scene.events, "--exposure",
                       "1600000000000700", "1600000000050700", "-o", scene.result("shifted.npy")} +
             kEdi);
        CHECK(array(scene.result("late.npy")).values == array(scene.result("shifted.npy")).values);
        const Outcome guess =
            must(scene.deblur(scene.result("guessed.npy"), Arguments{"--lag", "auto"} + kEdi));
        CHECK(guess.err.find("estimated lag of the events") != std::string::npos);
        const Outcome refused =
            run_ecir(scene.deblur(scene.result("x.npy"), Arguments{"--lag", "soon"} + kEdi));
        CHECK(refused.code == 2);
        CHECK(refused.err.find("--lag 'soon'") != std::string::npos);
    }

    TEST_CASE("quality and budget choose between the shipped networks") {
        const Scene& scene = Scene::get();
        const std::string file = scene.result("choice.json");
        const Arguments few{"--frames", "2", "--threshold", "0.2"};
        must(scene.deblur(scene.result("fast"),
                          Arguments{"--quality", "fast", "--report", file} + few));
        CHECK(nlohmann::json::parse(get(file))["exposures"][0]["model"] == "fusion-tiny");
        const Outcome cheap = must(
            scene.deblur(scene.result("cheap"),
                         Arguments{"--budget", "0.001", "--report", file, "--overwrite"} + few));
        CHECK(nlohmann::json::parse(get(file))["exposures"][0]["model"] == "fusion-tiny");
        CHECK(cheap.err.find("over the budget") != std::string::npos);
        const Outcome rich =
            must(scene.deblur(scene.result("rich"), Arguments{"--budget", "1e8"} + few));
        CHECK(rich.err.find("fusion takes") != std::string::npos);
        const Outcome refused =
            run_ecir(scene.deblur(scene.result("x.npy"), Arguments{"--budget", "5"} + kEdi));
        CHECK(refused.code == 2);
    }

    TEST_CASE("of an exposure with noise alone is said that nothing was sharpened") {
        const Scene& scene = Scene::get();
        const std::string events = scene.result("noise.txt");
        put(events, "1600000000.010000 3 4 1\n1600000000.030000 20 11 0\n");
        const std::string file = scene.result("noise.json");
        const Outcome outcome =
            must(Scene::deblur_of(scene.blurry, events, scene.result("noise"),
                                  {"--frames", "2", "--report", file, "--lag", "auto"}));
        CHECK(outcome.err.find("look like noise") != std::string::npos);
        CHECK(outcome.err.find("how late") != std::string::npos);
        const auto report = nlohmann::json::parse(get(file));
        CHECK(report["exposures"][0]["model"].is_null());
        CHECK(report["exposures"][0]["windows"].empty());
    }
}
