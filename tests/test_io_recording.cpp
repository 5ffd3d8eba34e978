#include <doctest/doctest.h>
#include <filesystem>
#include <string>

#include "tests/test_io_support.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/image.hpp"
#include "tools/io/recording.hpp"

using namespace ecir;
using namespace ecir::test;
namespace fs = std::filesystem;

namespace {

const std::string header = "file,start_us,end_us\n";

/// A sound recording of two images; a test then breaks a part of it.
struct Sample {
    Sample() {
        for (const auto* name : {"0.png", "1.png"}) {
            io::write_image(folder / name, {1, 1, 1, 8, {0.5F}});
        }
        put(folder / "exposures.csv", header + "0.png,100,200\n1.png,300,400\n");
        put(folder / "events.txt", "0.0001 0 0 1\n");
        put(folder / "meta.json", "{\"name\": \"a\"}\n");
        put(folder / "README", "About this recording\n");
    }
    void list(const std::string& lines) const { put(folder / "exposures.csv", header + lines); }
    template <class... Parts> void check_bad(const Parts&... parts) const {
        check_error(
            ExitCode::bad_input, [&] { io::open_recording(folder.path()); }, parts...);
    }
    TemporaryFolder folder;
};

} // namespace

TEST_SUITE("io") {

    TEST_CASE("recording: images, exposures and events are found") {
        const Sample sample;
        const auto recording = io::open_recording(sample.folder.path());
        REQUIRE(recording.items.size() == 2);
        CHECK(recording.full_name(recording.items[1]) == sample.folder / "1.png");
        CHECK(recording.items[1].exposure.start == 300);
        CHECK(recording.items[1].exposure.end == 400);
        CHECK(recording.events == sample.folder / "events.txt");
    }

    TEST_CASE("recording: events are told by content, whatever the name") {
        const Sample sample;
        fs::remove(sample.folder / "events.txt");
        Events events;
        events.push_back(1, 2, 3, 1);
        io::write_events(sample.folder / "data.bin", events.view());
        put(sample.folder / ".hidden", "0.0001 0 0 1\n");
        put(sample.folder / "other.csv", "a,b,c\n1,2,3\n");
        fs::create_symlink("nowhere", sample.folder / "broken");
        fs::create_directory(sample.folder / "sub");
        CHECK(io::open_recording(sample.folder.path()).events == sample.folder / "data.bin");
    }

    TEST_CASE("recording: no events file, or several") {
        const Sample sample;
        put(sample.folder / "more.txt", "346 260\n0.0001 0 0 1\n");
        sample.check_bad("several", "events.txt, more.txt");
        fs::remove(sample.folder / "events.txt");
        fs::remove(sample.folder / "more.txt");
        sample.check_bad("no events file", sample.folder.path().string());
    }

    TEST_CASE("recording: CR LF, blanks, a byte order mark and large times") {
        const Sample sample;
        put(sample.folder / "exposures.csv",
            "\xef\xbb\xbf"
            "file,start_us,end_us\r\n 0.png , 1615007563376030,1615007563480030 \r\n\r\n");
        const auto recording = io::open_recording(sample.folder.path());
        REQUIRE(recording.items.size() == 1);
        CHECK(recording.items[0].exposure.end == 1615007563480030);
    }

    TEST_CASE("recording: reversed and empty exposures name the line") {
        const Sample sample;
        sample.list("0.png,100,200\n1.png,400,300\n");
        sample.check_bad("exposures.csv", "line 3", "300", "400");
        sample.list("0.png,100,100\n");
        sample.check_bad("line 2", "not after its start");
    }

    TEST_CASE("recording: bad numbers and columns name the line") {
        const Sample sample;
        sample.list("0.png,1x,200\n");
        sample.check_bad("line 2", "start '1x'");
        sample.list("0.png,1,\n");
        sample.check_bad("line 2", "end ''");
        sample.list("0.png,1,1.5\n");
        sample.check_bad("end '1.5'");
        sample.list("0.png,1,99999999999999999999\n");
        sample.check_bad("line 2", "99999999999999999999");
        sample.list("0.png,1\n");
        sample.check_bad("line 2", "three columns");
        sample.list("0.png,1,2,3\n");
        sample.check_bad("line 2", "three columns");
    }

    TEST_CASE("recording: images must be there, inside the folder") {
        const Sample sample;
        sample.list("2.png,100,200\n");
        sample.check_bad("line 2", "'2.png'", "not there");
        sample.list("../0.png,100,200\n");
        sample.check_bad("line 2", "not inside");
        sample.list("a/../../0.png,100,200\n");
        sample.check_bad("not inside");
        sample.list("/etc/passwd,100,200\n");
        sample.check_bad("not inside");
        sample.list(",100,200\n");
        sample.check_bad("line 2", "not inside");
    }

    TEST_CASE("recording: images in a folder below") {
        const Sample sample;
        fs::create_directory(sample.folder / "images");
        fs::rename(sample.folder / "0.png", sample.folder / "images/0.png");
        sample.list("images/0.png,100,200\n");
        CHECK(io::open_recording(sample.folder.path()).items.size() == 1);
    }

    TEST_CASE("recording: the list must be there, with its header and a line") {
        const Sample sample;
        put(sample.folder / "exposures.csv", "0.png,100,200\n");
        sample.check_bad("line 1", "header");
        sample.list("");
        sample.check_bad("exposures.csv", "no image");
        put(sample.folder / "exposures.csv", "");
        sample.check_bad("no image");
        fs::remove(sample.folder / "exposures.csv");
        sample.check_bad("no exposures.csv");
        check_error(
            ExitCode::bad_input, [&] { io::open_recording(sample.folder / "none"); }, "none");
        check_error(
            ExitCode::bad_input, [&] { io::open_recording(sample.folder / "0.png"); },
            "not a recording");
    }

} // TEST_SUITE
