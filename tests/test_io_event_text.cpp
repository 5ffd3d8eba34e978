#include <cstdint>
#include <doctest/doctest.h>
#include <string>
#include <vector>

#include "tests/test_io_support.hpp"
#include "tools/io/event_file.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

io::EventFile read_text(const std::string& text) {
    const TemporaryFolder folder;
    return io::read_events(put(folder / "events.txt", text));
}

template <class... Parts> void check_bad_text(const std::string& text, const Parts&... parts) {
    check_error(
        ExitCode::bad_input, [&] { read_text(text); }, "events.txt", parts...);
}

} // namespace

TEST_SUITE("io") {

    TEST_CASE("event text: seconds become microseconds, columns are t x y p") {
        const auto file = read_text("0.000000 1 2 0\n0.000001 3 4 1\n12.5 65535 0 1\n");
        CHECK(file.events.t == std::vector<int64_t>{0, 1, 12500000});
        CHECK(file.events.x == std::vector<uint16_t>{1, 3, 65535});
        CHECK(file.events.y == std::vector<uint16_t>{2, 4, 0});
        CHECK(file.events.p == std::vector<uint8_t>{0, 1, 1});
        CHECK_FALSE(file.width.has_value());
    }

    TEST_CASE("event text: the sensor's size in the first line") {
        const auto file = read_text("240 180\n1 0 0 1\n");
        CHECK(file.width == 240);
        CHECK(file.height == 180);
        CHECK(file.events.size() == 1);
        check_bad_text("1 0 0 1\n240 180\n", "line 2", "2 columns");
        check_bad_text("0 180\n", "line 1", "width");
    }

    TEST_CASE("event text: times near 1.6e9 seconds are exact to the microsecond") {
        std::string text;
        std::vector<int64_t> expected;
        for (int64_t i = 0; i < 2000; ++i) {
            expected.push_back(1615007563000000 + i * 499);
            const std::string digits = std::to_string(expected.back());
            text += digits.substr(0, 10) + "." + digits.substr(10) + " 1 1 1\n";
        }
        CHECK(read_text(text).events.t == expected);
    }

    TEST_CASE("event text: further decimals are rounded, exponents are taken") {
        const auto file = read_text("0.000779999 1 1 0\n0.0007804 1 1 0\n0.0007805 1 1 0\n"
                                    "1.615007563376030000e+09 3.000e+00 40e-1 1.0\n"
                                    "1615007563.3760305000000000000000001 1 1 1\n");
        CHECK(file.events.t ==
              std::vector<int64_t>{780, 780, 781, 1615007563376030, 1615007563376031});
        CHECK(file.events.x[3] == 3);
        CHECK(file.events.y[3] == 4);
    }

    TEST_CASE("event text: negative times") {
        CHECK(read_text("-1.5 0 0 1\n-.000001 0 0 1\n-0 0 0 1\n").events.t ==
              std::vector<int64_t>{-1500000, -1, 0});
    }

    TEST_CASE("event text: polarity -1 and 1, not mixed with 0") {
        CHECK(read_text("0 0 0 -1\n0 0 0 1\n0 0 0 -1\n").events.p == std::vector<uint8_t>{0, 1, 0});
        check_bad_text("0 0 0 -1\n0 0 0 1\n0 0 0 0\n", "line 3", "polarity 0");
        check_bad_text("0 0 0 2\n", "line 1", "'2'");
        check_bad_text("0 0 0 0.5\n", "line 1", "'0.5'");
    }

    TEST_CASE("event text: no events") {
        check_bad_text("",
                       "empty"); // a recording that was cut off at once, rather than a still scene
        CHECK(read_text("\n\n# nothing\n").events.size() == 0);
        CHECK(read_text("346 260\n").width == 346);
    }

    TEST_CASE("event text: comments, blank lines, tabs, CR LF, no newline at the end") {
        const auto file = read_text("# t x y p\r\n1\t2  3 1\r\n \r\n# end\r\n2 3 4 0");
        CHECK(file.events.t == std::vector<int64_t>{1000000, 2000000});
    }

    TEST_CASE("event text: NaN, infinity and garbage name the line") {
        check_bad_text("0 0 0 1\nnan 0 0 1\n", "line 2", "nan");
        check_bad_text("inf 0 0 1\n", "line 1", "inf");
        check_bad_text("0 x 0 1\n", "line 1", "'x'");
        check_bad_text("1.2.3 0 0 1\n", "'1.2.3'");
        check_bad_text("1e 0 0 1\n", "'1e'");
        check_bad_text("1e+ 0 0 1\n", "'1e+'");
        check_bad_text("0x10 0 0 1\n", "'0x10'");
        check_bad_text(". 0 0 1\n", "'.'");
        check_bad_text("hello\n", "line 1", "1 column");
        check_bad_text("{\"a\": 1}\n", "line 1");
    }

    TEST_CASE("event text: missing and extra columns name the line") {
        check_bad_text("0 1 1 1\n0 1 1\n", "line 2", "3 columns");
        check_bad_text("0 1 1 1 1\n", "line 1", "more than 4");
    }

    TEST_CASE("event text: coordinates out of range") {
        check_bad_text("0 -1 0 1\n", "line 1", "x '-1'");
        check_bad_text("0 0 65536 1\n", "line 1", "y '65536'");
        check_bad_text("0 1.5 0 1\n", "line 1", "x '1.5'");
    }

    TEST_CASE("event text: times in smaller units are too large") {
        check_bad_text("1615007563376030 1 1 1\n", "line 1", "seconds");
        check_bad_text("1e400 1 1 1\n", "line 1", "too large");
        CHECK(read_text("1e-400 1 1 1\n").events.t[0] == 0);
    }

    TEST_CASE("event text: the first time that goes back is named") {
        check_bad_text("1 0 0 1\n# c\n2 0 0 1\n1.9 0 0 1\n1 0 0 1\n", "line 4", "1900000",
                       "2000000");
    }

    TEST_CASE("event text: 300,000 lines across the reader's blocks") {
        const Events events = many_events(300000);
        std::string text;
        for (size_t i = 0; i < events.size(); ++i) {
            const std::string t = std::to_string(events.t[i]);
            text += t.substr(0, 10) + "." + t.substr(10) + " " + std::to_string(events.x[i]) + " " +
                    std::to_string(events.y[i]) + " " + std::to_string(events.p[i]) + "\n";
        }
        const auto file = read_text(text);
        CHECK(file.events.t == events.t);
        CHECK(file.events.x == events.x);
        CHECK(file.events.y == events.y);
        CHECK(file.events.p == events.p);
        check_bad_text(text + "0 0 0 1\n", "line 300001", std::to_string(events.t.back()));
    }

    TEST_CASE("event text: an endless line is an error") {
        check_bad_text("0 0 0 1\n" + std::string(3000000, '1'), "line 1", "million");
    }

    TEST_CASE("event files: another kind, or not there") {
        const TemporaryFolder folder;
        const auto png = put(folder / "a.png", std::string("\x89PNG\r\n\x1a\n\0\0", 10));
        check_error(
            ExitCode::bad_input, [&] { io::read_events(png); }, "a.png", "neither HDF5",
            "nor text");
        check_error(
            ExitCode::bad_input, [&] { io::read_events(folder / "none.h5"); }, "none.h5",
            "No such file");
        check_error(
            ExitCode::bad_input, [&] { io::read_events(folder.path()); }, "directory");
    }

    TEST_CASE("events: one outside the image is named") {
        const Events events = many_events(1000);
        CHECK_NOTHROW(io::check_inside(events.view(), 346, 260, "e.h5"));
        check_error(
            ExitCode::bad_input, [&] { io::check_inside(events.view(), 346, 11, "e.h5"); }, "e.h5",
            "event 1 ", "346 x 11");
    }

} // TEST_SUITE
