#include <cstdlib>
#include <doctest/doctest.h>
#include <nlohmann/json.hpp>
#include <numeric>

#include "tests/aedat4_writer.hpp"
#include "tests/events_support.hpp"
#include "tools/io/recording.hpp"

using namespace ecir;
using namespace ecir::test;
namespace fs = std::filesystem;

namespace {

constexpr size_t kPacket = 1000; ///< events
constexpr Exposure kExposure{1615007563376100, 1615007563376900};

void add_events(Aedat4Writer& writer, const Events& events) {
    for (size_t i = 0; i < events.size(); i += kPacket) {
        writer.events(events.view(), i, std::min(i + kPacket, events.size()));
    }
}

std::vector<uint8_t> ramp(size_t count) {
    std::vector<uint8_t> bytes(count);
    std::iota(bytes.begin(), bytes.end(), uint8_t{0});
    return bytes;
}

/// A recording of one grey frame, as its writer stands before the events.
Aedat4Writer with_frame() {
    Aedat4Writer writer;
    writer.frame(kExposure, 4, 3, ramp(12));
    return writer;
}

} // namespace

TEST_SUITE("io") {
    TEST_CASE("AEDAT 4: events come back, whatever the compression, with and without a table") {
        const TemporaryFolder folder;
        const Events events = many_events(25'500);
        for (const auto compression :
             {format::Compression_none, format::Compression_lz4, format::Compression_lz4_high,
              format::Compression_zstd, format::Compression_zstd_high}) {
            for (const bool table : {true, false}) {
                CAPTURE(compression);
                CAPTURE(table);
                Aedat4Writer writer(compression);
                writer.frame(kExposure, 346, 260, ramp(size_t{346} * 260));
                writer.events(events.view(), 0, 0); // cameras write empty packets, too
                add_events(writer, events);
                const auto path = writer.write(folder / "recording", table);
                CHECK(io::holds_events(path));
                CHECK(equal(io::read_events(path).events.view(), events.view()));
                CHECK(io::open_recording(path).items.size() == 1);
            }
        }
    }

    TEST_CASE("AEDAT 4: the events of exposures, in any order") {
        const TemporaryFolder folder;
        const Events events = many_events(25'500);
        Aedat4Writer writer;
        add_events(writer, events);
        const auto path = writer.write(folder / "recording.aedat4");
        std::vector<Exposure> exposures;
        for (const auto& [first, last] : std::vector<std::pair<int64_t, int64_t>>{
                 {0, 10}, {300, 3000}, {333, 333}, {8000, 9000}, {2, 700}, {-5, -1}}) {
            exposures.push_back({events.t.front() + first, events.t.front() + last});
        }
        check_windows(path, events, exposures);
    }

    TEST_CASE("AEDAT 4: a recording that broke off gives what was written whole") {
        const TemporaryFolder folder;
        const Events events = many_events(4 * kPacket);
        Aedat4Writer writer = with_frame();
        add_events(writer, events);
        const auto whole = writer.write(folder / "whole", false);
        const auto cut = put(folder / "cut", get(whole).substr(0, get(whole).size() - 9));
        CHECK(io::read_events(cut).events.size() == 3 * kPacket);
        // So does one whose table is cut off, or does not say what packets hold.
        const auto ended = writer.write(folder / "ended");
        const auto damaged = put(folder / "damaged", get(ended).substr(0, get(ended).size() - 9));
        CHECK(equal(io::read_events(damaged).events.view(), events.view()));
        CHECK(io::open_recording(damaged).items.size() == 1);
        for (auto& entry : writer.entries()) {
            entry.elements = entry.first = entry.last = 0;
        }
        CHECK(equal(io::read_events(writer.write(folder / "old")).events.view(), events.view()));
    }

    TEST_CASE("AEDAT 4: frames and their exposures, grey and colour") {
        const TemporaryFolder folder;
        Aedat4Writer writer = with_frame();
        const auto format_of = [&](uint8_t type) {
            return [=](format::FrameBuilder& frame) {
                frame.add_exposure(800); // as later versions have it
                frame.add_format(type);
            };
        };
        writer.frame({5000, 5000}, 2, 2, ramp(12), format_of(16)); // BGR
        writer.frame({7000, 7000}, 2, 1, ramp(8), format_of(24));  // BGRA
        writer.frame({9000, 9800}, 2, 1, ramp(2), [](auto&) {});   // without an exposure
        writer.events(many_events(10).view(), 0, 10);
        const auto path = writer.write(folder / "recording.aedat4");
        CHECK(io::is_camera_file(path));
        const auto recording = io::open_recording(path);
        CHECK(recording.events == path);
        CHECK(recording.note.find("1 of 4 frames") != std::string::npos);
        REQUIRE(recording.items.size() == 3);
        CHECK(recording.items[0].exposure.start == kExposure.start);
        CHECK(recording.items[0].exposure.end == kExposure.end);
        CHECK(recording.items[1].exposure.start == 5000);
        CHECK(recording.items[1].exposure.end == 5800);
        CHECK(recording.items[2].name == "frame 2");
        CHECK(recording.full_name(recording.items[2]) == path.string() + ", frame 2");
        const io::Image grey = recording.read(recording.items[0]);
        CHECK(grey.width == 4);
        CHECK(grey.height == 3);
        CHECK(grey.channels == 1);
        CHECK(grey.bits == 8);
        CHECK(grey.pixels[11] == doctest::Approx(11 / 255.0));
        const io::Image colour = recording.read(recording.items[1]);
        REQUIRE(colour.pixels.size() == 12);
        CHECK(colour.channels == 3);
        CHECK(colour.pixels[0] == doctest::Approx(2 / 255.0)); // red, stored last
        CHECK(colour.pixels[5] == doctest::Approx(3 / 255.0)); // blue of the second pixel
        const io::Image alpha = recording.read(recording.items[2]);
        REQUIRE(alpha.pixels.size() == 6);
        CHECK(alpha.pixels[3] == doctest::Approx(6 / 255.0));
    }

    TEST_CASE("AEDAT 4: what is wrong with a file is said") {
        const TemporaryFolder folder;
        const Events events = many_events(3 * kPacket);
        const auto bad = [&](const fs::path& path, auto... parts) {
            check_error(
                ExitCode::bad_input, [&] { io::read_events(path); }, path.string(),
                std::string(parts)...);
        };
        const auto bad_recording = [&](const fs::path& path, auto... parts) {
            check_error(
                ExitCode::bad_input,
                [&] {
                    const auto recording = io::open_recording(path);
                    (void)recording.read(recording.items.front());
                },
                path.string(), std::string(parts)...);
        };
        Aedat4Writer sound = with_frame();
        add_events(sound, events);
        const auto path = sound.write(folder / "sound");
        const std::string bytes = get(path);
        bad(put(folder / "short", bytes.substr(0, 16)), "first line");
        bad(put(folder / "header", bytes.substr(0, 40)), "ends in its header");
        bad(put(folder / "root", bytes.substr(0, 18) + std::string(80, '\xff') + bytes.substr(98)),
            "header is damaged");
        std::string torn = bytes;
        torn.replace(bytes.size() / 2, 40, std::string(40, '\xff'));
        bad(put(folder / "torn", torn), "packet at byte");

        Aedat4Writer frames = with_frame();
        bad(frames.write(folder / "frames"), "no events");
        Aedat4Writer alone;
        add_events(alone, events);
        CHECK_FALSE(io::is_camera_file(alone.write(folder / "alone")));
        bad_recording(folder / "alone", "not a recording");
        Aedat4Writer two = with_frame();
        add_events(two, events);
        two.events(events.view(), 0, 10, 7);
        bad(two.write(folder / "two"), "several streams of events");

        Aedat4Writer wrong = with_frame();
        add_events(wrong, events);
        wrong.entries()[2].elements -= 1;
        bad(wrong.write(folder / "wrong"), "packet at byte", "table");
        for (const bool table : {true, false}) {
            Aedat4Writer back;
            back.events(events.view(), kPacket, 2 * kPacket);
            back.events(events.view(), 0, kPacket);
            bad(back.write(folder / "back", table), "event 1000", "go back");
            Events inside = many_events(10);
            std::swap(inside.t[3], inside.t[7]);
            Aedat4Writer mixed;
            mixed.events(inside.view(), 0, 10);
            bad(mixed.write(folder / "mixed", table), "event 4", "go back");
        }
        Events negative = many_events(10);
        negative.x[6] = 0xfffe;
        Aedat4Writer left;
        left.events(negative.view(), 0, 10);
        bad(left.write(folder / "left"), "negative", "event 6");

        const auto frame = [&](const char* name, size_t count, const auto& edit) {
            Aedat4Writer writer;
            writer.frame(kExposure, 4, 3, ramp(count), [&](format::FrameBuilder& one) {
                one.add_exposure(10);
                edit(one);
            });
            writer.events(events.view(), 0, 10);
            return writer.write(folder / name);
        };
        bad_recording(frame("few", 11, [](auto&) {}), "frame 0", "4 x 3 has 11 bytes");
        bad_recording(frame("deep", 24, [](auto& one) { one.add_format(2); }), "type 2");
        bad_recording(frame("cut", 12, [](auto& one) { one.add_left(3); }), "cut-out", "column 3");
        Aedat4Writer timeless;
        timeless.frame(kExposure, 4, 3, ramp(12), [](auto&) {});
        bad_recording(timeless.write(folder / "timeless"), "none of its 1 frames");
    }

    TEST_CASE("AEDAT 4: a camera's own file") {
        const char* data = std::getenv("ECIR_TEST_RECORDINGS");
        const fs::path folder = data == nullptr ? fs::path() : fs::path(data) / "formats";
        if (!fs::is_directory(folder)) {
            MESSAGE("no recordings here; set ECIR_TEST_RECORDINGS to run this");
            return;
        }
        const auto path = folder / "davis346_frames.aedat4";
        const auto expected =
            nlohmann::json::parse(get(folder / "expected.json"))["davis346_frames.aedat4"];
        const Events events = io::read_events(path).events;
        REQUIRE(events.size() == expected["events"]);
        CHECK(events.t.front() == expected["first_t"]);
        CHECK(events.t.back() == expected["last_t"]);
        CHECK(std::accumulate(events.x.begin(), events.x.end(), int64_t{0}) == expected["sum_x"]);
        CHECK(std::accumulate(events.y.begin(), events.y.end(), int64_t{0}) == expected["sum_y"]);
        CHECK(std::ranges::count(events.p, 1) == expected["on"]);
        const auto recording = io::open_recording(path);
        REQUIRE(recording.items.size() == expected["frames"].size());
        for (size_t i = 0; i < recording.items.size(); ++i) {
            const auto& frame = expected["frames"][i];
            CHECK(recording.items[i].exposure.start == frame["exposure_start"]);
            CHECK(recording.items[i].exposure.end == frame["exposure_end"]);
            const io::Image image = recording.read(recording.items[i]);
            CHECK(image.width == frame["width"]);
            const double sum = std::accumulate(image.pixels.begin(), image.pixels.end(), 0.0);
            CHECK(std::llround(255 * sum) == frame["pixel_sum"]);
        }
    }
}
