#pragma once
#include <atomic>
#include <csignal>
#include <cstdint>
#include <doctest/doctest.h>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <string>
#include <sys/resource.h>
#include <unistd.h>

#include "layers/events.hpp"
#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::test {

/// A folder of its own, removed after.
class TemporaryFolder {
public:
    TemporaryFolder() {
        static std::atomic<int> counter{0};
        path_ = std::filesystem::temp_directory_path() /
                ("ecir-test-io-" + std::to_string(::getpid()) + "-" + std::to_string(counter++));
        std::filesystem::create_directories(path_);
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] bool empty() const { return std::filesystem::is_empty(path_); }

private:
    std::filesystem::path path_;
};

/// Files cannot grow beyond `bytes` meanwhile: how a disk that fills up looks from inside.
class FileSizeLimit {
public:
    explicit FileSizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
        ::getrlimit(RLIMIT_FSIZE, &before_);
        const rlimit small{bytes, before_.rlim_max};
        ::setrlimit(RLIMIT_FSIZE, &small);
    }
    ~FileSizeLimit() {
        ::setrlimit(RLIMIT_FSIZE, &before_);
        (void)std::signal(SIGXFSZ, handler_);
    }
    FileSizeLimit(const FileSizeLimit&) = delete;
    FileSizeLimit& operator=(const FileSizeLimit&) = delete;

private:
    void (*handler_)(int);
    rlimit before_{};
};

inline std::filesystem::path put(const std::filesystem::path& path, const std::string& text) {
    std::ofstream(path, std::ios::binary) << text;
    return path;
}

inline std::string get(const std::filesystem::path& path) {
    const auto bytes = io::read_file(path);
    return {bytes.begin(), bytes.end()};
}

/// Copies the first `share` of a file.
inline std::filesystem::path truncate(const std::filesystem::path& from,
                                      const std::filesystem::path& to, double share) {
    const std::string all = get(from);
    return put(to, all.substr(0, static_cast<size_t>(static_cast<double>(all.size()) * share)));
}

/// Events of a 346 x 260 sensor, three to a microsecond, late in 64-bit time.
inline Events many_events(size_t count) {
    Events events;
    for (size_t i = 0; i < count; ++i) {
        events.push_back(1615007563376030 + static_cast<int64_t>(i / 3),
                         static_cast<uint16_t>(i * 7 % 346), static_cast<uint16_t>(i * 11 % 260),
                         static_cast<uint8_t>(i % 5 < 2));
    }
    return events;
}

/// Runs `action`, which must throw an Error of this code that mentions every one of `parts`.
template <class Action, class... Parts>
void check_error(ExitCode code, Action action, const Parts&... parts) {
    bool thrown = false;
    try {
        action();
    } catch (const Error& error) {
        thrown = true;
        const std::string message = error.what();
        CAPTURE(message);
        CHECK(error.code() == code);
        for (const std::string& part : std::initializer_list<std::string>{parts...}) {
            CAPTURE(part);
            CHECK(message.find(part) != std::string::npos);
        }
        CHECK(message.find("; ") != std::string::npos); // the remedy
    }
    CHECK_MESSAGE(thrown, "no Error was thrown");
}

} // namespace ecir::test
