#include <doctest/doctest.h>

#include <sys/resource.h>

#include "tests/cli_support.hpp"

using namespace ecir;
using namespace ecir::test;

namespace {

constexpr int kColumns = 32;
constexpr int kRows = 24;
constexpr int64_t kPeriod = 10'000; ///< from exposure to exposure, microseconds

/// A recording of many exposures: three images and one exposure's events, time and again.
class LongRecording {
public:
    LongRecording(const fs::path& folder, size_t exposures, size_t events_each, bool text)
        : folder_(folder) {
        fs::create_directory(folder);
        for (size_t i = 0; i < 3; ++i) {
            io::Image image{kColumns, kRows, 1, 8, {}};
            for (size_t pixel = 0; pixel < size_t{kColumns} * kRows; ++pixel) {
                image.pixels.push_back(0.2F + 0.001F * static_cast<float>((pixel * (i + 7)) % 600));
            }
            io::write_image(folder / image_name(i), image);
        }
        std::string list = "file,start_us,end_us\n";
        for (size_t i = 0; i < exposures; ++i) {
            const int64_t begin = kStart + static_cast<int64_t>(i) * kPeriod;
            list += image_name(i % 3) + "," + std::to_string(begin) + "," +
                    std::to_string(begin + kPeriod * 4 / 5) + "\n";
        }
        put(folder / "exposures.csv", list);
        const Events events = repeated(exposures, events_each);
        if (text) {
            write_text(events);
        } else {
            io::write_events(folder / "events.h5", events.view());
        }
    }

    /// Deblurs all of it. Returns the most memory that this took, in KiB.
    [[nodiscard]] long peak(const fs::path& out) const {
        const TemporaryFolder streams;
        Surroundings around;
        around.environment = {{"ECIR_VALIDATION", "0"}}; // the layer keeps what it saw
        const Arguments arguments{"deblur",   "-i", folder_.string(), "-o", out.string(),
                                  "--frames", "2",  "--overwrite"};
        const pid_t child = start(arguments + kEdi, streams / "out", streams / "err", around);
        int status = 0;
        rusage used{};
        REQUIRE(::wait4(child, &status, 0, &used) == child);
        CAPTURE(get(streams / "err"));
        REQUIRE(status == 0);
        return used.ru_maxrss;
    }

private:
    static std::string image_name(size_t i) { return "blurry_" + std::to_string(i) + ".png"; }

    static Events repeated(size_t exposures, size_t each) {
        Events events;
        for (size_t i = 0; i < exposures * each; ++i) {
            const size_t k = i % each;
            events.push_back(kStart + static_cast<int64_t>(i / each) * kPeriod +
                                 static_cast<int64_t>(k * size_t{kPeriod} / each),
                             static_cast<uint16_t>(k * 7 % kColumns),
                             static_cast<uint16_t>(k * 5 % kRows), k % 3 == 0 ? 1 : 0);
        }
        return events;
    }

    void write_text(const Events& events) const {
        std::string text;
        for (size_t i = 0; i < events.size(); ++i) {
            const std::string t = std::to_string(events.t[i]);
            text += t.substr(0, 10) + "." + t.substr(10) + " " + std::to_string(events.x[i]) + " " +
                    std::to_string(events.y[i]) + " " + std::to_string(events.p[i]) + "\n";
        }
        put(folder_ / "events.txt", text);
    }

    fs::path folder_;
};

#ifdef __SANITIZE_ADDRESS__
constexpr long kGrowth = 12 * 1024; // KiB; what was freed stays a while
#else
constexpr long kGrowth = 6 * 1024;
#endif

} // namespace

TEST_SUITE("cli streaming") {
    TEST_CASE("10,000 exposures take the memory of 2,000: HDF5 to an array") {
        const TemporaryFolder folder;
        const LongRecording little(folder / "little", 2000, 600, false);
        const LongRecording large(folder / "large", 10'000, 600, false);
        const long before = little.peak(folder / "little.npy");
        const long after = large.peak(folder / "large.npy");
        MESSAGE("peak memory: ", before, " and ", after, " KiB");
        // Its events alone are 76 MiB, its frames 59 MiB.
        CHECK(after - before < kGrowth);
        CHECK(io::read_npy(folder / "large.npy").shape ==
              std::vector<size_t>{20'000, kRows, kColumns});
    }

    TEST_CASE("10,000 exposures take the memory of 1,000: text to a folder") {
        const TemporaryFolder folder;
        const LongRecording little(folder / "little", 1000, 100, true);
        const LongRecording large(folder / "large", 10'000, 100, true);
        const long before = little.peak(folder / "little-out");
        const long after = large.peak(folder / "large-out");
        MESSAGE("peak memory: ", before, " and ", after, " KiB");
        // Its events alone are 13 MiB, frames.csv 1.3 MiB.
        CHECK(after - before < 4 * 1024);
        CHECK(lines(folder / "large-out/frames.csv").size() == 20'001);
        CHECK(lines(folder / "large-out/frames.csv").back() ==
              "019999.png,1,1600000099998000,blurry_0.png");
    }
}
