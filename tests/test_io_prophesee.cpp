#include <array>
#include <cstdlib>
#include <doctest/doctest.h>
#include <nlohmann/json.hpp>
#include <numeric>

#include "tests/events_support.hpp"
#include "tests/test_io_support.hpp"

using namespace ecir;
using namespace ecir::test;
namespace fs = std::filesystem;

namespace {

/// Appends words as a camera does.
template <class Word> class Words {
public:
    void add(uint64_t word) {
        const auto value = static_cast<Word>(word);
        bytes_.append(reinterpret_cast<const char*>(&value), sizeof(value));
    }
    /// Words that are no events, so many that readers keep places within the file to go back to.
    void pass_over(uint64_t word) {
        for (int i = 0; i < 20; ++i) {
            add(word);
        }
    }
    [[nodiscard]] const std::string& bytes() const { return bytes_; }

private:
    std::string bytes_;
};

std::string evt2(const Events& events) {
    Words<uint32_t> words;
    words.add(1U << 28U); // an event before the first time
    int64_t high = -1;
    for (size_t i = 0; i < events.size(); ++i) {
        if (events.t[i] / 64 != high) {
            high = events.t[i] / 64;
            words.add(0x80000000U | (static_cast<uint64_t>(high) & 0xfffffffU));
            words.pass_over(0xa0000001U); // triggers
        }
        words.add((uint64_t{events.p[i]} << 28U) |
                  (static_cast<uint64_t>(events.t[i] % 64) << 22U) |
                  (uint64_t{events.x[i]} << 11U) | events.y[i]);
    }
    return words.bytes();
}

/// A word for each event, or for two where they are neighbours.
std::string evt21(const Events& events, bool swapped) {
    Words<uint64_t> words;
    const auto add = [&](uint64_t word) {
        words.add(swapped ? (word << 32U) | (word >> 32U) : word);
    };
    int64_t high = -1;
    for (size_t i = 0; i < events.size();) {
        if (events.t[i] / 64 != high) {
            high = events.t[i] / 64;
            add((uint64_t{8} << 60U) | (static_cast<uint64_t>(high) << 32U));
            words.pass_over((uint64_t{0xe} << 60U) | (uint64_t{0xe} << 28U)); // either way round
        }
        const auto first = static_cast<uint16_t>(events.x[i] / 32 * 32);
        uint64_t valid = 0;
        const size_t from = i;
        do {
            valid |= uint64_t{1} << (events.x[i] - first);
            ++i;
        } while (i < events.size() && events.t[i] == events.t[from] &&
                 events.y[i] == events.y[from] && events.p[i] == events.p[from] &&
                 events.x[i] > events.x[i - 1] && events.x[i] < first + 32);
        add((uint64_t{events.p[from]} << 60U) |
            (static_cast<uint64_t>(events.t[from] % 64) << 54U) | (uint64_t{first} << 43U) |
            (uint64_t{events.y[from]} << 32U) | valid);
    }
    return words.bytes();
}

/// Single events, or vectors of 12 and 8 where neighbours follow.
std::string evt3(const Events& events) {
    Words<uint16_t> words;
    words.add(0x2001); // before the first time and row
    int64_t high = -1;
    int64_t low = -1;
    int row = -1;
    for (size_t i = 0; i < events.size();) {
        const int64_t t = events.t[i];
        if (t / 4096 != high) {
            high = t / 4096;
            low = 0;
            words.add(0x8000U | (static_cast<uint64_t>(high) & 0xfffU));
        }
        if (t % 4096 != low) {
            low = t % 4096;
            words.add(0x6000U | static_cast<uint64_t>(low));
            words.add(0x8000U | (static_cast<uint64_t>(high) & 0xfffU)); // said again
        }
        if (events.y[i] != row) {
            row = events.y[i];
            words.add(static_cast<uint64_t>(row));
        }
        const size_t from = i;
        uint64_t valid = 0;
        do {
            valid |= uint64_t{1} << (events.x[i] - events.x[from]);
            ++i;
        } while (i < events.size() && events.t[i] == t && events.y[i] == row &&
                 events.p[i] == events.p[from] && events.x[i] > events.x[i - 1] &&
                 events.x[i] < events.x[from] + 20);
        const uint64_t place = (uint64_t{events.p[from]} << 11U) | events.x[from];
        if (valid == 1) {
            words.add(0x2000U | place);
        } else {
            words.add(0x3000U | place);
            words.add(0x4000U | (valid & 0xfffU));
            words.add(0x5000U | (valid >> 12U));
        }
        words.pass_over(0xa101); // triggers
    }
    return words.bytes();
}

std::string dat(const Events& events) {
    Words<uint64_t> words;
    for (size_t i = 0; i < events.size(); ++i) {
        words.add((static_cast<uint64_t>(events.t[i]) & 0xffffffffU) |
                  (uint64_t{events.x[i]} << 32U) | (uint64_t{events.y[i]} << 46U) |
                  (uint64_t{events.p[i]} << 60U));
    }
    return words.bytes();
}

/// Bursts of a row, some of them neighbours, 100 s long: EVT 3's clock turns round six times.
Events bursts() {
    Events events;
    for (size_t i = 0; i < 800'000; ++i) {
        const size_t burst = i / 8;
        events.push_back(5'000'000 + static_cast<int64_t>(burst) * 1009,
                         static_cast<uint16_t>(burst * 37 % 1200 + (i % 8) * (1 + burst % 3)),
                         static_cast<uint16_t>(burst * 11 % 720),
                         static_cast<uint8_t>(burst % 3 > 0));
    }
    return events;
}

const std::string kDatHeader = "% Data file containing CD events\n% Version 2\n% Width 1280\n"
                               "% Height 720\n";
const std::string kDatType("\x0c\x08", 2);

/// One recording in every format.
struct Files {
    TemporaryFolder folder;
    Events events = bursts();
    std::vector<fs::path> paths;
    Files() {
        const auto add = [&](const char* name, const std::string& header,
                             const std::string& words) {
            paths.push_back(put(folder / name, header + words));
            REQUIRE(words.size() > (size_t{5} << 20U)); // more than the places kept are apart
        };
        add("old2", "% Date 2020-09-25 07:48:31\n% evt 2.0\n% geometry 1280x720\n", evt2(events));
        add("new2", "% evt 2.0\n% format EVT2;height=720;width=1280\n% end\n", evt2(events));
        add("new21", "% format EVT21;height=720;width=1280\n% end\n", evt21(events, false));
        add("swapped", "% format EVT21;height=720;width=1280;endianness=legacy\n% end\n",
            evt21(events, true));
        add("older", "% evt 2.1\n% system_ID 49\n% geometry 1280x720\n", evt21(events, true));
        add("old3", "% evt 3.0\r\n% geometry 1280x720\r\n", evt3(events));
        add("new3", "% format EVT3;height=720;width=1280\n% end\n", evt3(events));
        add("dat", kDatHeader, kDatType + dat(events));
    }
    static Files& get() {
        static Files files;
        return files;
    }
};

} // namespace

TEST_SUITE("io") {
    TEST_CASE("Prophesee: events come back from every format") {
        const Files& files = Files::get();
        for (const fs::path& path : files.paths) {
            CAPTURE(path.string());
            CHECK(io::holds_events(path));
            const io::EventFile file = io::read_events(path);
            CHECK(equal(file.events.view(), files.events.view()));
            CHECK(file.width == 1280);
            CHECK(file.height == 720);
            // A recording that broke off within a word.
            const std::string bytes = test::get(path);
            const auto cut = put(files.folder / "cut", bytes.substr(0, bytes.size() - 1));
            const size_t lost = files.events.size() - io::read_events(cut).events.size();
            CHECK(lost <= 8); // the last word's
        }
    }

    TEST_CASE("Prophesee: the events of exposures, in any order") {
        const Files& files = Files::get();
        std::vector<Exposure> exposures;
        for (const auto& [after, length] :
             std::vector<std::pair<int64_t, int64_t>>{{0, 40'000},
                                                      {30'000, 20'000},
                                                      {40'000'000, 100'000},
                                                      {16'000'000, 2'000'000},
                                                      {-10, 5},
                                                      {100'890'000, 1'000},
                                                      {90'000'000, 100'000},
                                                      {70'000'000, 100'000}}) {
            const int64_t start = files.events.t.front() + after;
            exposures.push_back({start, start + length});
        }
        for (const fs::path& path : files.paths) {
            check_windows(path, files.events, exposures);
        }
    }

    TEST_CASE("Prophesee: single events leave EVT 3.0's vectors where they are") {
        Words<uint16_t> words;
        for (const uint64_t word : {
                 0x8001, 0x6002, 0x0007, // time 4098, row 7
                 0x3864, 0x4001,         // brighter from 100 on, the first of 12
                 0x2005,                 // darker at 5
                 0x5080,                 // from 112 on, the last of 8
                 0x4002,                 // from 120 on, the second of 12
             }) {
            words.add(word);
        }
        const TemporaryFolder folder;
        const Events events =
            io::read_events(put(folder / "mixed", "% evt 3.0\n" + words.bytes())).events;
        CHECK(events.t == std::vector<int64_t>(4, 4098));
        CHECK(events.x == std::vector<uint16_t>{100, 5, 119, 121});
        CHECK(events.y == std::vector<uint16_t>(4, 7));
        CHECK(events.p == std::vector<uint8_t>{1, 0, 1, 1});
    }

    TEST_CASE("Prophesee: faults of the transmission are passed over") {
        const TemporaryFolder folder;
        Words<uint16_t> words;
        for (const uint64_t word : {0x8005, 0x6001, 0x0007, 0x2003, // time 20481, (3, 7)
                                    0x8004, 0x6002, 0x2004,         // high bits go back: 20482
                                    0x00f7, 0x2005, 0x0008,         // row 247 of 240
                                    0x2140, 0x2006}) {              // column 320 of 320
            words.add(word);
        }
        const Events events =
            io::read_events(
                put(folder / "evt3", "% format EVT3;height=240;width=320\n% end\n" + words.bytes()))
                .events;
        CHECK(events.t == std::vector<int64_t>{20481, 20482, 20482});
        CHECK(events.x == std::vector<uint16_t>{3, 4, 6});
        CHECK(events.y == std::vector<uint16_t>{7, 7, 8});
    }

    TEST_CASE("Prophesee: clocks of 34 and 32 bits turn round") {
        const TemporaryFolder folder;
        for (const int64_t turn : {int64_t{1} << 34U, int64_t{1} << 32U}) {
            Events events;
            for (const int64_t t : {turn - 900, turn - 3, turn + 5, turn + 800}) {
                events.push_back(t, 3, 4, 1);
            }
            const auto path = turn == int64_t{1} << 34U
                                  ? put(folder / "evt2", "% evt 2.0\n" + evt2(events))
                                  : put(folder / "dat", kDatHeader + kDatType + dat(events));
            CHECK(equal(io::read_events(path).events.view(), events.view()));
        }
    }

    TEST_CASE("Prophesee: what is wrong with a file is said") {
        const TemporaryFolder folder;
        const auto bad = [&](const std::string& content, auto... parts) {
            const auto path = put(folder / "bad.raw", content);
            check_error(
                ExitCode::bad_input, [&] { io::read_events(path); }, path.string(),
                std::string(parts)...);
        };
        bad("% Date 2020-09-25", "does not end");
        bad("% Date 2020-09-25\n", "names no format");
        bad("% evt 4.0\n", "format '4.0'", "2.0, 2.1 and 3.0");
        bad("% evt 3.0\n% format HISTO3D;width=320\n% end\n", "format 'HISTO3D'");
        bad("% format EVT21;endianness=big\n% end\n", "byte order 'big'");
        bad("% Version 1\n" + kDatType, "version '1'");
        bad(kDatHeader, "ends in its header");
        bad(kDatHeader + std::string("\x0e\x08", 2), "type 14 with 8 bytes");
        Events back = many_events(9);
        std::swap(back.t[2], back.t[7]);
        bad(kDatHeader + kDatType + dat(back), "go back", "event 3");
        CHECK(io::read_events(put(folder / "none.raw", "% evt 3.0\n")).events.size() == 0);
    }

    TEST_CASE("Prophesee: cameras' own files") {
        const char* data = std::getenv("ECIR_TEST_RECORDINGS");
        const fs::path folder = data == nullptr ? fs::path() : fs::path(data) / "formats";
        if (!fs::is_directory(folder)) {
            MESSAGE("no recordings here; set ECIR_TEST_RECORDINGS to run this");
            return;
        }
        const auto all = nlohmann::json::parse(test::get(folder / "expected.json"));
        for (const char* name : {"gen3_evt2.raw", "gen41_evt3.raw", "ncars.dat"}) {
            CAPTURE(name);
            const auto& expected = all[name];
            const Events events = io::read_events(folder / name).events;
            REQUIRE(events.size() == expected["events"]);
            CHECK(std::ranges::count(events.p, 1) == expected["on"]);
            CHECK(std::ranges::count(events.p, 0) == expected["off"]);
            const auto event = [&](size_t i) {
                return std::array<int64_t, 4>{events.t[i], events.x[i], events.y[i], events.p[i]};
            };
            for (size_t i = 0; i < 3; ++i) {
                CHECK(event(i) == expected["first_events_txyp"][i]);
            }
            CHECK(event(events.size() - 1) == expected["last_event_txyp"]);
            const auto sum = [](const auto& values) {
                return std::accumulate(values.begin(), values.end(), int64_t{0});
            };
            CHECK(sum(events.x) == expected["sum_x"]);
            CHECK(sum(events.y) == expected["sum_y"]);
            CHECK(sum(events.t) - events.t.front() * static_cast<int64_t>(events.size()) ==
                  expected["sum_t_minus_first"]);
        }
    }
}
