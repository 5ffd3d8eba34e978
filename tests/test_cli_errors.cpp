#include <doctest/doctest.h>
#include <sys/stat.h>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

/// A file in the scene's folder.
fs::path file(const std::string& name, const std::string& text) {
    return put(Scene::get().folder / name, text);
}

/// Text events within the exposure, then these lines.
std::string text_events(const std::string& more) {
    return "1600000000.010 5 6 1\n1600000000.020 7 8 0\n" + more;
}

/// `deblur` of the scene's image with other events.
Arguments with_events(const fs::path& events) {
    const Scene& scene = Scene::get();
    return Scene::deblur_of(scene.blurry, events, scene.result("no"), kEdi);
}

Arguments at(const std::string& start, const std::string& end, const std::string& out) {
    const Scene& scene = Scene::get();
    return Arguments{"deblur",
                     "-i",
                     scene.blurry.string(),
                     "-e",
                     scene.events.string(),
                     "--exposure",
                     start,
                     end,
                     "-o",
                     scene.result(out)} +
           kEdi;
}

/// Nothing, whole or temporary, may stay of the runs of a test case.
class NothingLeft {
public:
    NothingLeft() = default;
    ~NothingLeft() { CHECK(names(Scene::get().results) == before_); }
    NothingLeft(const NothingLeft&) = delete;
    NothingLeft& operator=(const NothingLeft&) = delete;

private:
    std::vector<std::string> before_ = names(Scene::get().results);
};

} // namespace

TEST_SUITE("cli errors") {
    TEST_CASE("a damaged image is named") {
        const Scene& scene = Scene::get();
        const NothingLeft nothing;
        const auto of = [&](const fs::path& image) {
            return Scene::deblur_of(image, scene.events, scene.result("no"), kEdi);
        };
        must_fail(3, of("nosuch.png"), {"nosuch.png", "No such file", "; "});
        truncate(scene.blurry, scene.folder / "half.png", 0.5);
        must_fail(3, of(scene.folder / "half.png"), {"half.png", "truncated", "; "});
        must_fail(3, of(file("empty.png", "")), {"empty.png", "empty", "; "});
        must_fail(3, of(file("text.png", "not an image")), {"text.png", "PNG", "; "});
        must_fail(3, of(scene.events), {"events.h5", "holds events", "with -e", "; "});
    }

    TEST_CASE("a damaged events file is named, with the place") {
        const Scene& scene = Scene::get();
        const NothingLeft nothing;
        must_fail(3, with_events("nosuch.h5"), {"nosuch.h5", "No such file", "; "});
        truncate(scene.events, scene.folder / "half.h5", 0.5);
        must_fail(3, with_events(scene.folder / "half.h5"), {"half.h5", "; "});
        must_fail(3, with_events(file("empty.txt", "")), {"empty.txt", "empty", "; "});
        must_fail(3, with_events(scene.blurry), {"blurry_000000.png", "not an events file", "; "});
        must_fail(3, with_events(file("cut.txt", text_events("1600000000.03 4"))),
                  {"cut.txt", "line 3", "2 columns", "; "});
        must_fail(3, with_events(file("words.txt", text_events("a b c d\n"))),
                  {"words.txt", "line 3", "; "});
    }

    TEST_CASE("wrong events are named, the first one") {
        const NothingLeft nothing;
        must_fail(3, with_events(file("x.txt", text_events("1600000000.03 48 6 1\n"))),
                  {"x.txt", "event 2", "x = 48", "48 x 40", "; "});
        must_fail(3, with_events(file("y.txt", text_events("1600000000.03 4 40 1\n"))),
                  {"y.txt", "event 2", "y = 40", "; "});
        must_fail(3,
                  with_events(file("back.txt", text_events("1600000000.015 4 4 1\n"
                                                           "1600000000.001 4 4 1\n"))),
                  {"back.txt", "line 3", "1600000000015000", "sort", "; "});
        must_fail(3, with_events(file("p.txt", text_events("1600000000.03 4 4 2\n"))),
                  {"p.txt", "line 3", "polarity '2'", "; "});
        must_fail(3, with_events(file("nan.txt", text_events("nan 4 4 1\n"))),
                  {"nan.txt", "line 3", "'nan'", "; "});
        must_fail(3, with_events(file("inf.txt", text_events("inf 4 4 1\n"))),
                  {"inf.txt", "line 3", "'inf'", "; "});
        must_fail(3, with_events(file("sensor.txt", "64 40\n" + text_events(""))),
                  {"sensor.txt", "64 x 40", "blurry_000000.png", "48 x 40", "; "});
    }

    TEST_CASE("an exposure must be one, and on the events' clock") {
        const NothingLeft nothing;
        must_fail(3, at("1600000000050000", "1600000000000000", "no"),
                  {"blurry_000000.png", "1600000000000000", "not after its start", "; "});
        must_fail(3, at("1600000000050000", "1600000000050000", "no"), {"not after its start"});
        for (const auto& [start, end] :
             {std::pair{"0", "50000"}, std::pair{"1700000000000000", "1700000000050000"},
              std::pair{"-90", "-40"}}) {
            must_fail(3, at(start, end, "no"), {"events.h5", start, end, "outside", "; "});
        }
        must_fail(2, at("soon", "5", "no"), {"'soon'", "microseconds"});
        must_fail(2, at("0.5", "5", "no"), {"'0.5'", "microseconds"});
    }

    TEST_CASE("an exposure's place among the events counts the lag") {
        const NothingLeft nothing;
        must_fail(3,
                  at("1600000000000000", "1600000000050000", "no") + Arguments{"--lag", "1000000"},
                  {"events.h5", "late by 1000000 us", "outside", "; "});
        must(at("1599999999000000", "1599999999050000", "lag.npy") + Arguments{"--lag", "1000000"});
        fs::remove(Scene::get().result("lag.npy"));
        must_fail(2, at("0", "1", "no") + Arguments{"--lag", "-9223372036854775808"},
                  {"--lag", "4e18"});
    }

    TEST_CASE("an exposure that the events cover in small part is told of") {
        const auto warned = [](const std::string& start) {
            const Scene& scene = Scene::get();
            const Outcome outcome = must(at(start, "1600000000050000", "part.npy"));
            fs::remove(scene.result("part.npy"));
            return outcome.err.find("less than half of the exposure") != std::string::npos;
        };
        CHECK(warned("1599999999000000"));
        CHECK(!warned("1600000000000000"));
    }

    TEST_CASE("a time may be written with an exponent") {
        must(at("1.6e15", "1.60000000005e15", "exponent.npy"));
        must(at("1600000000000000", "1600000000050000", "digits.npy"));
        CHECK(get(Scene::get().result("exponent.npy")) == get(Scene::get().result("digits.npy")));
    }

    TEST_CASE("events outside the exposure are ignored, both its ends belong to it") {
        const Scene& scene = Scene::get();
        Events more;
        more.push_back(kStart - 1, 20, 20, 1);
        const io::EventFile held = io::read_events(scene.events);
        const EventView events = held.events.view();
        for (size_t i = 0; i < events.size(); ++i) {
            more.push_back(events.t[i], events.x[i], events.y[i], events.p[i]);
        }
        const auto write = [&](const std::string& name) {
            io::write_events(scene.folder / name, more.view());
            must(Scene::deblur_of(scene.blurry, scene.folder / name, scene.result(name + ".npy")));
            return get(scene.result(name + ".npy"));
        };
        must(scene.deblur(scene.result("inside.npy")));
        more.push_back(kEnd + 1, 20, 20, 1);
        CHECK(write("outside.h5") == get(scene.result("inside.npy")));
        more.t.back() = kEnd;
        CHECK(write("end.h5") != get(scene.result("inside.npy")));
        more.t.back() = kEnd + 1;
        more.t.front() = kStart;
        CHECK(write("start.h5") != get(scene.result("inside.npy")));
    }

    TEST_CASE("pixels with more events than a fusion network takes are said") {
        const Scene& scene = Scene::get();
        std::string lines;
        for (int i = 0; i < 800; ++i) {
            lines += "1600000000.03" + std::to_string(1000 + i) + " 4 4 1\n";
        }
        const Outcome outcome =
            must(Scene::deblur_of(scene.blurry, file("busy.txt", text_events(lines)),
                                  scene.result("busy.npy"), {"--threshold", "0.2"}));
        CHECK(outcome.err.find("blurry_000000.png: 1 of its pixels have more than 768 events") !=
              std::string::npos);
    }

    TEST_CASE("an exposure without events is the blurry frame, and said") {
        const Scene& scene = Scene::get();
        const io::Image blurry = io::read_image(scene.blurry);
        const fs::path around = file("around.txt", "1599999999.9 4 4 1\n1600000000.9 4 4 0\n");
        const fs::path none = file("none.txt", "48 40\n");
        io::write_events(scene.folder / "none.h5", Events{}.view());
        int number = 0;
        for (const fs::path& events : {around, none, scene.folder / "none.h5"}) {
            for (const Arguments& method : {kEdi, Arguments{}}) {
                const std::string out = scene.result("still" + std::to_string(number++) + ".npy");
                const Outcome outcome = must(Scene::deblur_of(scene.blurry, events, out, method));
                CHECK(outcome.err.find("ecir: warning: ") != std::string::npos);
                CHECK(outcome.err.find("blurry_000000.png") != std::string::npos);
                const io::Array frames = io::read_npy(out);
                CHECK(frames.shape[0] == 14);
                CHECK(
                    std::equal(blurry.pixels.begin(), blurry.pixels.end(), frames.values.begin()));
                CHECK(std::equal(blurry.pixels.rbegin(), blurry.pixels.rend(),
                                 frames.values.rbegin()));
            }
        }
    }

    TEST_CASE("options that do not fit are refused") {
        const Scene& scene = Scene::get();
        const NothingLeft nothing;
        const std::string no = scene.result("no");
        must_fail(2, scene.deblur(no, {"-m", "ecir", "--keypoints", "9"}),
                  {"10 keypoints", "9", "; "});
        must_fail(2, scene.deblur(no, {"-m", "ecir", "--threshold", "0.2"}),
                  {"--threshold", "edi"});
        const std::string esl_net =
            std::string(ECIR_TEST_DATA) + "/fixtures/esl-net-41x29.safetensors";
        for (const std::string option : {"--keypoints", "--refine", "--threshold"}) {
            must_fail(2, scene.deblur(no, {"-m", esl_net, option, "1"}), {option, "; "});
        }
        const std::string fusion =
            std::string(ECIR_TEST_DATA) + "/fixtures/fusion-61x45.safetensors";
        must_fail(2, scene.deblur(no, {"-m", fusion, "--keypoints", "1"}), {"--keypoints", "; "});
        must_fail(2, scene.deblur(no, {"-m", fusion, "--refine", "3"}),
                  {"--refine 3", "twice", "ecir", "; "});
        must_fail(2, scene.deblur(no, {"-m", "edi", "--threshold", "nan"}), {"--threshold", "nan"});
        must_fail(2, scene.deblur(no, {"-m", "edi", "--threshold", "-1"}), {"--threshold", "-1"});
        must_fail(2, scene.deblur(no, {"--times", "-1.01"}), {"--times", "[-1, 1]"});
        must_fail(2, scene.deblur(no, {"--times", "0", "nan"}), {"--times"});
        must_fail(2, scene.deblur(no, {"--frames", "0"}), {"--frames", "0"});
        must_fail(2, scene.deblur(no, {"--fps", "0"}), {"--fps", "0"});
        must_fail(2, scene.deblur(no, {"--fps", "nan"}), {"--fps", "nan"});
        must_fail(2, scene.deblur(no, {"--fps", "1e12"}), {"--fps", "million"});
        must_fail(2, scene.deblur(no, {"--fps", "5", "--frames", "3"}), {"--fps", "--frames"});
        must_fail(2, scene.deblur(no, {"--times", "0", "--frames", "3"}), {"--times", "--frames"});
        must_fail(2, scene.deblur(no + ".png"), {"no.png", "folder"});
        must_fail(2, scene.deblur(no, kEdi + Arguments{"--size", "49x40"}),
                  {"--size 49 x 40", "48 x 40", "; "});
        must_fail(2, {"deblur", "-i", scene.blurry.string(), "-o", no}, {"-e", "--exposure"});
        must(scene.deblur(scene.result("yes.npy"),
                          {"-m", "ecir", "--keypoints", "10", "--frames", "1"}));
        fs::remove(scene.result("yes.npy"));
    }

    TEST_CASE("nothing that is read or written is replaced by something else") {
        const Scene& scene = Scene::get();
        const NothingLeft nothing;
        const std::string no = scene.result("no");
        const Arguments overwrite = kEdi + Arguments{"--overwrite", "--report"};
        for (const fs::path& read : {scene.blurry, scene.events}) {
            const std::string before = get(read);
            must_fail(2, scene.deblur(no, overwrite + Arguments{read.string()}),
                      {read.filename().string(), "input", "; "});
            CHECK(get(read) == before);
        }
        must_fail(2, scene.deblur(no + ".npy", overwrite + Arguments{no + ".npy"}),
                  {"no.npy", "--report", "; "});
        must_fail(2, scene.deblur(no, overwrite + Arguments{no + "/report.json"}),
                  {"no/report.json", "--report", "; "});
        must_fail(2, scene.deblur(no, overwrite + Arguments{""}), {"--report", "empty", "; "});
        must_fail(2, scene.deblur("", kEdi), {"name is empty", "; "});
        fs::create_directories(scene.folder / "kept/truth");
        must_fail(2,
                  scene.deblur((scene.folder / "kept").string(), kEdi + Arguments{"--overwrite"}),
                  {"kept", "does not look like an output", "; "});
    }

    TEST_CASE("frames outlive a report that cannot be written") {
        const Scene& scene = Scene::get();
        const fs::path report = scene.folder / "report";
        REQUIRE(::mkfifo(report.c_str(), 0600) == 0);
        const int reader = ::open(report.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
        const TemporaryFolder folder;
        const pid_t child = start(scene.deblur(scene.result("outlive"),
                                               kEdi + Arguments{"--overwrite", "--report", report}),
                                  folder / "out", folder / "err");
        // The reader goes away once it has some of what is written before any frame.
        char byte = 0;
        for (int ms = 0; ::read(reader, &byte, 1) != 1; ++ms) {
            REQUIRE(ms < 60'000);
            ::usleep(1000);
        }
        ::close(reader);
        CHECK(wait_for(child) != 0);
        CHECK(get(folder / "err").find("Broken pipe") != std::string::npos);
        CHECK(fs::exists(fs::path(scene.result("outlive")) / "frames.csv"));
        fs::remove_all(scene.result("outlive"));
    }

    TEST_CASE("an output that cannot be written is named") {
        const Scene& scene = Scene::get();
        file("plain", "x");
        for (const std::string name : {"out", "out.npy", "out.mp4"}) {
            must_fail(3, scene.deblur((scene.folder / ("plain/" + name)).string(), kEdi),
                      {"plain/" + name, "; "});
            must_fail(3, scene.deblur((scene.folder / ("nosuch/" + name)).string(), kEdi),
                      {"nosuch/" + name, "; "});
        }
        must_fail(2, scene.deblur(scene.folder / "plain", kEdi + Arguments{"--overwrite"}),
                  {"plain"});
        must_fail(2, scene.deblur(scene.folder.path(), kEdi + Arguments{"--overwrite"}),
                  {"another output"});
    }

    TEST_CASE("a full disk is exit 5 and leaves nothing") {
        const Scene& scene = Scene::get();
        {
            const NothingLeft nothing;
            Surroundings small;
            small.largest_file = 1000;
            for (const std::string out : {"full", "full.npy", "full.mp4", "full.avi"}) {
                must_fail(5, scene.deblur(scene.result(out), kEdi), {"full", "; "}, small);
            }
        }
        fs::create_symlink("/dev/full", scene.folder / "device.npy");
        must_fail(5, scene.deblur(scene.folder / "device.npy", kEdi + Arguments{"--overwrite"}),
                  {"/dev/full", "No space left", "; "});
    }

    TEST_CASE("without a Vulkan driver the package that brings one is named") {
        const Scene& scene = Scene::get();
        const NothingLeft nothing;
        Surroundings none;
        none.environment = {{"VK_ICD_FILENAMES", "/nonexistent.json"},
                            {"VK_DRIVER_FILES", "/nonexistent.json"}};
        for (const Arguments& arguments :
             {scene.deblur(scene.result("no")), Arguments{"devices"},
              Arguments{"devices", "--json"}, Arguments{"verify", "--op", "curve"}}) {
            must_fail(4, arguments, {"mesa-vulkan-drivers"}, none);
        }
    }
}
