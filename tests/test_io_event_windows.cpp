#include <cstdint>
#include <doctest/doctest.h>
#include <random>
#include <string>
#include <vector>

#include "tests/events_support.hpp"
#include "tests/test_io_support.hpp"
#include "tools/io/event_windows.hpp"

using namespace ecir;
using namespace ecir::test;
using Reading = io::EventWindows::Reading;

namespace {

constexpr int64_t start = 1'600'000'000'000'000;

/// A thousand events to each seventh microsecond, so that equal times lie across blocks.
Events bursts(size_t count) {
    Events events = many_events(count);
    for (size_t i = 0; i < count; ++i) {
        events.t[i] = start + static_cast<int64_t>(i / 1000) * 7;
    }
    return events;
}

std::string text_of(const Events& events) {
    std::string text;
    for (size_t i = 0; i < events.size(); ++i) {
        const std::string t = std::to_string(events.t[i]);
        text += t.substr(0, 10) + "." + t.substr(10) + " " + std::to_string(events.x[i]) + " " +
                std::to_string(events.y[i]) + " " + std::to_string(events.p[i]) + "\n";
    }
    return text;
}

/// Several blocks of one recording, in both formats.
struct Files {
    Events events = bursts(900'000);
    TemporaryFolder folder;
    std::vector<std::filesystem::path> paths;
    Files() {
        io::write_events(folder / "events.h5", events.view());
        paths = {folder / "events.h5", put(folder / "events.txt", text_of(events))};
    }
    static Files& get() {
        static Files files;
        return files;
    }
};

void check_windows(const std::vector<Exposure>& exposures) {
    for (const auto& path : Files::get().paths) {
        ecir::test::check_windows(path, Files::get().events, exposures);
    }
}

Exposure at(int64_t first, int64_t last) {
    return {start + first, start + last};
}

/// Writes these times, in seconds, as text.
std::filesystem::path text_file(const TemporaryFolder& folder, const std::string& lines) {
    return put(folder / "events.txt", lines);
}

} // namespace

TEST_SUITE("io") {
    TEST_CASE("event windows: exposures one after another, apart and overlapping") {
        check_windows({at(-10, 5), at(7, 700), at(701, 1400), at(1000, 1500), at(1000, 1200),
                       at(4000, 4001), at(6000, 9000), at(20'000, 30'000)});
    }

    TEST_CASE("event windows: exposures in any order") {
        std::mt19937 random(5);
        std::vector<Exposure> exposures{at(6200, 6300), at(0, 7), at(6300, 6300), at(-9, 9000)};
        for (int i = 0; i < 12; ++i) {
            const auto first = static_cast<int64_t>(random() % 6500);
            exposures.push_back(at(first, first + static_cast<int64_t>(random() % 900)));
        }
        check_windows(exposures);
    }

    TEST_CASE("event windows: the file's span, told from its ends") {
        for (const auto& path : Files::get().paths) {
            const io::EventWindows windows(path);
            REQUIRE(windows.span().has_value());
            CHECK(windows.span()->first == start);
            CHECK(windows.span()->last == start + int64_t{899} * 7);
        }
        const TemporaryFolder folder;
        const auto span = [&](const std::string& text) {
            return io::EventWindows(text_file(folder, text)).span();
        };
        CHECK(span("64 48\n1 2 3 1\n2 2 3 1\n# end\n\n")->last == 2'000'000);
        CHECK(span("1 2 3 1")->last == 1'000'000);
        CHECK(span("1 2 3 1\n3 2 3 1\n" + std::string(200'000, '\n'))->last == 3'000'000);
        CHECK(!span("64 48\n# none\n").has_value());
        const io::EventWindows sized(text_file(folder, "64 48\n1 2 3 1\n"));
        CHECK(sized.width() == 64);
        CHECK(sized.height() == 48);
        io::write_events(folder / "none.h5", {});
        io::EventWindows none(folder / "none.h5");
        CHECK(!none.span().has_value());
        CHECK(none.read(at(0, 10)).events.size() == 0);
    }

    TEST_CASE("event windows: times that go back are found where they are passed") {
        const TemporaryFolder folder;
        Events events = bursts(900'000);
        events.t[700'000] -= 8;
        io::write_events(folder / "back.h5", events.view());
        const auto path = folder / "back.h5";
        io::EventWindows between(path);
        CHECK(between.read(at(0, 70)).events.size() == 11'000);
        check_error(
            ExitCode::bad_input, [&] { between.read(at(6000, 6100)); }, "back.h5", "event 700000",
            "sort");
        io::EventWindows behind(path);
        behind.read(at(0, 70));
        check_error(
            ExitCode::bad_input, [&] { behind.finish(); }, "event 700000");
        // A single exposure away from there is none of its business.
        io::EventWindows sparse(path, Reading::sparse);
        CHECK(sparse.read(at(0, 70)).events.size() == 11'000);
        CHECK_NOTHROW(sparse.finish());
        check_error(
            ExitCode::bad_input, [&] { sparse.read(at(4890, 4910)); }, "event 700000");
    }

    TEST_CASE("event windows: a search that meets times out of order is an error") {
        const TemporaryFolder folder;
        Events events = bursts(900'000);
        for (size_t i = 262'144; i < 600'000; ++i) {
            events.t[i] += 100'000;
        }
        io::write_events(folder / "hill.h5", events.view());
        io::EventWindows sparse(folder / "hill.h5", Reading::sparse);
        check_error(
            ExitCode::bad_input, [&] { sparse.read(at(6000, 6100)); }, "hill.h5", "sort");
    }

    TEST_CASE("event windows: a last time before the first is found at once, with its place") {
        const TemporaryFolder folder;
        const auto path = text_file(folder, "3 0 0 1\n4 0 0 1\n3.5 0 0 1\n1 0 0 1\n");
        check_error(
            ExitCode::bad_input, [&] { io::EventWindows windows(path); }, "events.txt", "line 3",
            "3500000");
        Events events = bursts(3000);
        events.t[2999] = start - 1;
        io::write_events(folder / "e.h5", events.view());
        check_error(
            ExitCode::bad_input, [&] { io::EventWindows windows(folder / "e.h5"); }, "event 2999");
    }

    TEST_CASE("event windows: text is checked line by line, up to the end") {
        const TemporaryFolder folder;
        const auto path = text_file(folder, text_of(bursts(100'000)) + "1600000001 0 0 1\n"
                                                                       "1600000002 0 0 -1\n");
        io::EventWindows windows(path);
        CHECK(windows.span()->last == 1'600'000'002'000'000);
        CHECK(windows.read(at(0, 0)).events.size() == 1000);
        check_error(
            ExitCode::bad_input, [&] { windows.finish(); }, "line 100002", "polarity -1");
    }
}
