#pragma once
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <doctest/doctest.h>
#include <fcntl.h>
#include <filesystem>
#include <initializer_list>
#include <sstream>
#include <string>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include "tests/test_io_support.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/image.hpp"
#include "tools/io/npy.hpp"

/// The real program, run as a person runs it.
namespace ecir::test {

namespace fs = std::filesystem;

using Arguments = std::vector<std::string>;

struct Outcome {
    int code = -1; ///< exit code; 128 + the signal that ended it
    std::string out;
    std::string err;
};

/// What surrounds a run, beside its arguments.
struct Surroundings {
    std::vector<std::pair<std::string, std::string>> environment;
    fs::path folder;          ///< working folder
    rlim_t largest_file = 0;  ///< bytes that a file may have; 0: no bound
    bool full_output = false; ///< stdout is a full disk
};

/// Starts the program with its output in two files.
inline pid_t start(const Arguments& arguments, const fs::path& out, const fs::path& err,
                   const Surroundings& around = {}) {
    std::vector<char*> argv;
    std::string program = ECIR_TOOL;
    argv.push_back(program.data());
    Arguments copies = arguments;
    for (std::string& argument : copies) {
        argv.push_back(argument.data());
    }
    argv.push_back(nullptr);
    const pid_t child = ::fork();
    if (child != 0) {
        return child;
    }
    const int flags = O_WRONLY | O_CREAT | O_TRUNC;
    ::dup2(::open(around.full_output ? "/dev/full" : out.c_str(), flags, 0600), STDOUT_FILENO);
    ::dup2(::open(err.c_str(), flags, 0600), STDERR_FILENO);
    for (const auto& [name, value] : around.environment) {
        ::setenv(name.c_str(), value.c_str(), 1);
    }
    if (!around.folder.empty() && ::chdir(around.folder.c_str()) != 0) {
        ::_exit(126);
    }
    if (around.largest_file > 0) {
        const rlimit bound{around.largest_file, around.largest_file};
        ::setrlimit(RLIMIT_FSIZE, &bound);
    }
    ::execv(argv[0], argv.data());
    ::_exit(127);
}

inline int wait_for(pid_t child) {
    int status = 0;
    REQUIRE(::waitpid(child, &status, 0) == child);
    return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

inline Outcome run_ecir(const Arguments& arguments, const Surroundings& around = {}) {
    const TemporaryFolder folder;
    const int code = wait_for(start(arguments, folder / "out", folder / "err", around));
    return {code, around.full_output ? "" : get(folder / "out"), get(folder / "err")};
}

inline Arguments operator+(Arguments left, const Arguments& right) {
    left.insert(left.end(), right.begin(), right.end());
    return left;
}

inline std::string joined(const Arguments& arguments) {
    std::string text;
    for (const std::string& argument : arguments) {
        text += " " + argument;
    }
    return text;
}

/// A run that must succeed; its output.
inline Outcome must(const Arguments& arguments, const Surroundings& around = {}) {
    Outcome outcome = run_ecir(arguments, around);
    CAPTURE(joined(arguments));
    CAPTURE(outcome.err);
    REQUIRE(outcome.code == 0);
    return outcome;
}

/// A run that must fail with this code and one line on stderr, last of all, that begins with
/// `ecir:` and has every one of the parts.
inline void must_fail(int code, const Arguments& arguments,
                      std::initializer_list<std::string> parts, const Surroundings& around = {}) {
    const Outcome outcome = run_ecir(arguments, around);
    CAPTURE(joined(arguments));
    CAPTURE(outcome.err);
    CHECK(outcome.code == code);
    REQUIRE(!outcome.err.empty());
    CHECK(outcome.err.back() == '\n');
    const size_t before = outcome.err.rfind('\n', outcome.err.size() - 2);
    const std::string line = outcome.err.substr(before == std::string::npos ? 0 : before + 1);
    CHECK(line.starts_with("ecir: "));
    for (const std::string& part : parts) {
        CAPTURE(part);
        CHECK(line.find(part) != std::string::npos);
    }
}

/// The names in a folder, hidden ones too.
inline std::vector<std::string> names(const fs::path& folder) {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator(folder)) {
        found.push_back(entry.path().filename().string());
    }
    std::sort(found.begin(), found.end());
    return found;
}

inline std::vector<std::string> lines(const fs::path& file) {
    std::istringstream in(get(file));
    std::vector<std::string> all;
    for (std::string line; std::getline(in, line);) {
        all.push_back(line);
    }
    return all;
}

constexpr int kWidth = 48;
constexpr int kHeight = 40;
constexpr int64_t kStart = 1'600'000'000'000'000; ///< as late as real clocks are
constexpr int64_t kEnd = kStart + 50'000;

/// A picture with edges in all directions, textured, without black or white parts.
inline io::Image still(int channels, int bits = 8) {
    io::Image image;
    image.width = 2 * kWidth;
    image.height = 2 * kHeight;
    image.channels = channels;
    image.bits = bits;
    for (int y = 0; y < image.height; ++y) {
        for (int x = 0; x < image.width; ++x) {
            const double wave =
                std::sin(0.35 * x) * std::cos(0.28 * y) + 0.3 * std::sin(0.9 * y - x);
            const double disc = std::hypot(x - 40, y - 35) < 18 ? 0.25 : 0;
            for (int c = 0; c < channels; ++c) {
                image.pixels.push_back(
                    static_cast<float>(0.4 + 0.15 * wave + disc * (1 - 0.3 * c)));
            }
        }
    }
    return image;
}

/// Simulates that picture moving; the scene is a recording of `count` exposures of 50 ms from
/// kStart.
inline void make_scene(const fs::path& still_path, const fs::path& scene, int channels,
                       const Arguments& more = {}) {
    io::write_image(still_path, still(channels));
    must(Arguments{"simulate", "-i", still_path.string(), "-o", scene.string(), "--size", "48x40",
                   "--threshold", "0.2", "--travel", "4", "--exposure-us", "50000", "--start",
                   std::to_string(kStart)} +
         more);
}

/// A scene made once for a file of tests, and a place for what they write.
struct Scene {
    TemporaryFolder folder;
    fs::path grey = folder / "grey";
    fs::path blurry = grey / "blurry_000000.png";
    fs::path events = grey / "events.h5";
    fs::path results = folder / "results";

    Scene() {
        make_scene(folder / "still.png", grey, 1);
        fs::create_directory(results);
    }
    static Scene& get() {
        static Scene scene;
        return scene;
    }
    [[nodiscard]] std::string result(const std::string& name) const {
        return (results / name).string();
    }
    /// `deblur` of the scene's frame.
    [[nodiscard]] Arguments deblur(const std::string& out, const Arguments& more = {}) const {
        return deblur_of(blurry, events, out, more);
    }
    static Arguments deblur_of(const fs::path& image, const fs::path& events,
                               const std::string& out, const Arguments& more = {}) {
        return Arguments{"deblur",
                         "-i",
                         image.string(),
                         "-e",
                         events.string(),
                         "--exposure",
                         std::to_string(kStart),
                         std::to_string(kEnd),
                         "-o",
                         out} +
               more;
    }
};

/// What a method without a long start needs.
inline const Arguments kEdi{"-m", "edi", "--threshold", "0.2"};

inline double rms_difference(const std::vector<float>& a, const std::vector<float>& b) {
    REQUIRE(a.size() == b.size());
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) {
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    }
    return std::sqrt(sum / static_cast<double>(a.size()));
}

} // namespace ecir::test
