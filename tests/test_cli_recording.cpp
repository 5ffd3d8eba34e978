#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "tests/aedat4_writer.hpp"
#include "tests/cli_support.hpp"
#include "tools/io/recording.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

/// Three exposures in a folder.
struct Three {
    TemporaryFolder folder;
    fs::path scene = folder / "scene";
    Three() { make_scene(folder / "still.png", scene, 1, {"--count", "3"}); }
    static Three& get() {
        static Three three;
        return three;
    }
    /// A copy whose files may be changed.
    [[nodiscard]] fs::path copy(const std::string& name) const {
        fs::copy(scene, folder / name, fs::copy_options::recursive);
        return folder / name;
    }
    [[nodiscard]] std::string result(const std::string& name) const {
        return (folder / name).string();
    }
    [[nodiscard]] Arguments deblur(const fs::path& input, const std::string& out,
                                   const Arguments& more = {}) const {
        return Arguments{"deblur", "-i", input.string(), "-o", result(out)} + kEdi + more;
    }
};

} // namespace

TEST_SUITE("cli recording") {
    TEST_CASE("the frames of all exposures are numbered on, with times and sources") {
        const Three& three = Three::get();
        must(three.deblur(three.scene, "out", {"--frames", "4"}));
        CHECK(names(three.result("out")).size() == 13);
        const auto csv = lines(three.result("out") + "/frames.csv");
        REQUIRE(csv.size() == 13);
        CHECK(csv[0] == "file,t_normalised,t_us,source");
        CHECK(csv[1] == "000000.png,-1,1600000000000000,blurry_000000.png");
        CHECK(csv[5] == "000004.png,-1,1600000000050000,blurry_000001.png");
        CHECK(csv[12] == "000011.png,1,1600000000150000,blurry_000002.png");
        must(three.deblur(three.scene, "out.npy", {"--frames", "4"}));
        CHECK(io::read_npy(three.result("out.npy")).shape ==
              std::vector<size_t>{12, kHeight, kWidth});
        must(three.deblur(three.scene, "out.mp4", {"--frames", "4"}));
    }

    TEST_CASE("only some exposures of a recording") {
        const Three& three = Three::get();
        must(three.deblur(three.scene, "whole", {"--frames", "2"}));
        for (const auto& [options, count] :
             {std::pair<Arguments, size_t>{{"--only", "1"}, 2}, {{"--only", "1", "2"}, 4}}) {
            const std::string out = "only-" + std::to_string(count);
            must(three.deblur(three.scene, out, Arguments{"--frames", "2"} + options));
            REQUIRE(names(three.result(out)).size() == count + 1);
            for (size_t i = 0; i < count; ++i) {
                CHECK(get(three.result(out) + "/00000" + std::to_string(i) + ".png") ==
                      get(three.result("whole") + "/00000" + std::to_string(i + 2) + ".png"));
            }
        }
        must_fail(2, three.deblur(three.scene, "far", {"--only", "1", "3"}),
                  {"3 exposures, 0 to 2"});
        must_fail(2, three.deblur(three.scene, "turned", {"--only", "2", "1"}), {"first exposure"});
        must_fail(2, three.deblur(three.scene, "minus", {"--only", "-1"}), {"--only"});
    }

    TEST_CASE("a camera's file gives what its frames and events give in a folder") {
        const Three& three = Three::get();
        must(three.deblur(three.scene, "folder", {"--frames", "4"}));
        const auto recording = io::open_recording(three.scene);
        const Events events = io::read_events(recording.events).events;
        Aedat4Writer writer;
        writer.events(events.view(), 0, events.size() / 2);
        for (const auto& item : recording.items) {
            const io::Image image = recording.read(item);
            std::vector<uint8_t> bytes(image.pixels.size());
            std::ranges::transform(image.pixels, bytes.begin(), [](float value) {
                return static_cast<uint8_t>(std::lround(255 * value));
            });
            writer.frame(item.exposure, image.width, image.height, bytes);
        }
        // A last one that the events do not reach: nothing moves in it.
        writer.frame({events.t.back() + 10, events.t.back() + 20}, kWidth, kHeight,
                     std::vector<uint8_t>(size_t{kWidth} * kHeight, 99));
        writer.events(events.view(), events.size() / 2, events.size());
        const auto path = writer.write(three.folder / "recording.aedat4");
        const auto done = must(three.deblur(path, "file", {"--frames", "4"}));
        CHECK(done.err.find("frame 3: ") != std::string::npos);
        const auto csv = lines(three.result("file") + "/frames.csv");
        REQUIRE(csv.size() == 17);
        CHECK(csv[5] == "000004.png,-1,1600000000050000,frame 1");
        for (int i = 0; i < 12; ++i) {
            const std::string name =
                "/0000" + std::string(i < 10 ? "0" : "") + std::to_string(i) + ".png";
            CAPTURE(name);
            CHECK(get(three.result("file") + name) == get(three.result("folder") + name));
        }
        const io::Image last = io::read_image(three.result("file") + "/000015.png");
        CHECK(std::ranges::count(last.pixels, 99 / 255.0F) == kWidth * kHeight);
        const auto info = nlohmann::json::parse(must({"info", "-i", path.string(), "--json"}).out);
        CHECK(info["events"]["format"] == "AEDAT 4");
        CHECK(info["events"]["count"] == events.size());
        CHECK(info["events"]["positive"] == std::ranges::count(events.p, 1));
        CHECK(info["events"]["first_us"] == events.t.front());
        CHECK(info["events"]["last_us"] == events.t.back());
        CHECK(info["frames"]["count"] == 4);
        CHECK(info["frames"]["width"] == kWidth);
        CHECK(info["frames"]["exposure_us"]["least"] == 10);
        CHECK(info["frames"]["exposure_us"]["median"] == 50'000);
        CHECK(info["frames"]["apart_us"] == 50'000);
        const auto folder =
            nlohmann::json::parse(must({"info", "-i", three.scene.string(), "--json"}).out);
        CHECK(folder["frames"]["count"] == 3);
        CHECK(folder["events"]["count"] == events.size());
        const auto lines_path = put(three.folder / "two.txt", "1 2 3 1\n2 2 3 0");
        CHECK(must({"info", "-i", lines_path.string()}).out.starts_with("events     2 in two.txt"));
        const auto text = must({"info", "-i", recording.events.string()}).out;
        CHECK(text.find("in events.h5, HDF5") != std::string::npos);
        CHECK(text.find("none in it") != std::string::npos);
        must_fail(2, three.deblur(path, "twice", {"-e", path.string()}),
                  {"a recording holds both"});
    }

    TEST_CASE("late events are found, told of in the report, and allowed for") {
        const TemporaryFolder folder;
        io::write_image(folder / "still.png", still(1));
        must({"simulate", "-i", folder / "still.png", "-o", folder / "scene", "--size", "88x72",
              "--travel", "10", "--exposure-us", "50000", "--start", std::to_string(kStart),
              "--count", "3"});
        constexpr int64_t kLate = 10'000; // of 50 ms
        const Arguments middle{"deblur",
                               "-i",
                               folder / "scene/blurry_000001.png",
                               "-e",
                               folder / "scene/events.h5",
                               "--exposure",
                               std::to_string(kEnd - kLate),
                               std::to_string(2 * kEnd - kStart - kLate)};
        const auto report = [&](const std::string& lag) {
            const fs::path file = folder / (lag + ".json");
            must(middle + kEdi + Arguments{"--lag", lag, "-o", folder / lag, "--report", file});
            return nlohmann::json::parse(get(file));
        };
        const auto late = [](const nlohmann::json& found) {
            return found["exposures"][0]["warnings"].dump().find("\"late\"") != std::string::npos;
        };
        const auto assumed = report("0");
        CHECK(std::abs(assumed["estimated_lag_us"].get<double>() - kLate) < 2'000);
        CHECK(late(assumed));
        const auto found = report("auto");
        CHECK(found["lag_us"] == found["estimated_lag_us"]);
        CHECK_FALSE(late(found));
        CHECK_FALSE(late(report(std::to_string(kLate))));
    }

    TEST_CASE("an exposure of it gives what it gives alone") {
        const Three& three = Three::get();
        must(three.deblur(three.scene, "all.npy", {"--frames", "4"}));
        must(Arguments{"deblur", "-i", (three.scene / "blurry_000001.png").string(), "-e",
                       (three.scene / "events.h5").string(), "--exposure", "1600000000050000",
                       "1600000000100000", "-o", three.result("alone.npy"), "--frames", "4"} +
             kEdi);
        const auto all = io::read_npy(three.result("all.npy")).values;
        const auto alone = io::read_npy(three.result("alone.npy")).values;
        CHECK(std::equal(alone.begin(), alone.end(),
                         all.begin() + static_cast<std::ptrdiff_t>(alone.size())));
    }

    TEST_CASE("an existing output is kept without --overwrite and replaced with it") {
        const Three& three = Three::get();
        must(three.deblur(three.scene, "kept", {"--frames", "2"}));
        const std::string before = get(three.result("kept") + "/frames.csv");
        must_fail(2, three.deblur(three.scene, "kept"), {"kept", "exists", "--overwrite"});
        CHECK(get(three.result("kept") + "/frames.csv") == before);
        must(three.deblur(three.scene, "kept", {"--frames", "3", "--overwrite"}));
        CHECK(names(three.result("kept")).size() == 10);
        must(three.deblur(three.scene, "kept.npy", {"--frames", "2"}));
        must_fail(2, three.deblur(three.scene, "kept.npy"), {"kept.npy", "--overwrite"});
        must(three.deblur(three.scene, "kept.npy", {"--frames", "3", "--overwrite"}));
        CHECK(io::read_npy(three.result("kept.npy")).shape[0] == 9);
    }

    TEST_CASE("an output that holds the input is refused") {
        const Three& three = Three::get();
        const fs::path scene = three.copy("holds");
        must_fail(2, three.deblur(scene, "holds", {"--overwrite"}), {"holds", "another output"});
        CHECK(fs::exists(scene / "exposures.csv"));
    }

    TEST_CASE("an error in a later exposure leaves no frame of the earlier ones") {
        const Three& three = Three::get();
        const fs::path scene = three.copy("damaged");
        truncate(three.scene / "blurry_000002.png", scene / "blurry_000002.png", 0.5);
        for (const std::string out : {"left", "left.npy", "left.mp4"}) {
            const auto before = names(three.folder.path());
            must_fail(3, three.deblur(scene, out), {"blurry_000002.png", "truncated"});
            CHECK(names(three.folder.path()) == before);
        }
        io::Image other = still(1);
        io::write_image(scene / "blurry_000002.png", other);
        must_fail(3, three.deblur(scene, "left"), {"blurry_000002.png", "96 x 80", "48 x 40"});
        must_fail(3, three.deblur(scene, "left", {"--size", "24x20"}), {"blurry_000002.png"});
    }

    TEST_CASE("exposures that overlap and come in any order give what each gives alone") {
        const Three& three = Three::get();
        const fs::path scene = three.copy("mixed");
        put(scene / "exposures.csv", "file,start_us,end_us\n"
                                     "blurry_000002.png,1600000000100000,1600000000150000\n"
                                     "blurry_000000.png,1600000000000000,1600000000050000\n"
                                     "blurry_000001.png,1600000000050000,1600000000100000\n"
                                     "blurry_000001.png,1600000000050000,1600000000100000\n");
        must(three.deblur(three.scene, "sorted.npy", {"--frames", "2"}));
        must(three.deblur(scene, "mixed.npy", {"--frames", "2"}));
        const auto sorted = io::read_npy(three.result("sorted.npy")).values;
        const auto mixed = io::read_npy(three.result("mixed.npy")).values;
        const size_t each = sorted.size() / 3;
        REQUIRE(mixed.size() == 4 * each);
        const std::array<size_t, 4> place{2, 0, 1, 1};
        for (size_t i = 0; i < place.size(); ++i) {
            CHECK(std::equal(mixed.begin() + static_cast<std::ptrdiff_t>(i * each),
                             mixed.begin() + static_cast<std::ptrdiff_t>((i + 1) * each),
                             sorted.begin() + static_cast<std::ptrdiff_t>(place[i] * each)));
        }
    }

    TEST_CASE("of several errors the first exposure's is told") {
        const Three& three = Three::get();
        const fs::path scene = three.copy("several");
        put(scene / "blurry_000001.png", "not an image");
        truncate(three.scene / "blurry_000002.png", scene / "blurry_000002.png", 0.5);
        must_fail(3, three.deblur(scene, "no"), {"blurry_000001.png", "PNG"});
        // The first one's frames do not fit the disk; reading the second is ahead of that.
        Surroundings small;
        small.largest_file = 1000;
        must_fail(5, three.deblur(scene, "no"), {"; "}, small);
    }

    TEST_CASE("times that go back behind the last exposure are an error") {
        const Three& three = Three::get();
        const fs::path scene = three.copy("unsorted");
        Events events = io::read_events(scene / "events.h5").events;
        for (const int64_t time : {400'000, 300'000, 500'000}) {
            events.push_back(kStart + time, 1, 1, 1);
        }
        io::write_events(scene / "events.h5", events.view());
        const std::string place = "event " + std::to_string(events.size() - 2);
        const auto before = names(three.folder.path());
        must_fail(3, three.deblur(scene, "no"), {"events.h5", place, "sort"});
        CHECK(names(three.folder.path()) == before);
    }

    TEST_CASE("a folder that is no recording says what is missing") {
        const Three& three = Three::get();
        const fs::path scene = three.copy("lacking");
        must_fail(2, three.deblur(scene, "no", {"-e", "events.h5"}), {"-e"});
        put(scene / "exposures.csv", "file,start_us,end_us\nblurry_000000.png,5,4\n");
        must_fail(3, three.deblur(scene, "no"), {"exposures.csv", "line 2", "4", "5"});
        put(scene / "exposures.csv", "file,start_us,end_us\nnosuch.png,5,6\n");
        must_fail(3, three.deblur(scene, "no"), {"exposures.csv", "line 2", "nosuch.png"});
        fs::remove(scene / "events.h5");
        put(scene / "exposures.csv", "file,start_us,end_us\nblurry_000000.png,5,6\n");
        must_fail(3, three.deblur(scene, "no"), {"lacking", "no events file"});
        fs::remove(scene / "exposures.csv");
        must_fail(3, three.deblur(scene, "no"), {"lacking", "exposures.csv"});
    }

    TEST_CASE("SIGTERM leaves nothing") {
        const Three& three = Three::get();
        for (const std::string out : {"ended", "ended.npy", "ended.mp4"}) {
            const auto before = names(three.folder.path());
            const TemporaryFolder streams;
            // Long enough to be met at work.
            const pid_t child = start(
                {"deblur", "-i", three.scene.string(), "-o", three.result(out), "--frames", "2000"},
                streams / "out", streams / "err");
            // A temporary shows that the work has begun.
            for (int i = 0; i < 1000 && names(three.folder.path()) == before; ++i) {
                ::usleep(10'000);
            }
            CHECK(names(three.folder.path()) != before);
            ::usleep(100'000);
            ::kill(child, SIGTERM);
            CHECK(wait_for(child) == 128 + SIGTERM);
            CHECK(names(three.folder.path()) == before);
        }
    }
}
