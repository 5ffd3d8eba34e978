#include "tools/ecir/console.hpp"

#include <algorithm>
#include <cstdio>
#include <unistd.h>
#include <utility>

namespace ecir::cli {

Console::Console(std::string what, size_t total)
    : what_(std::move(what)), total_(total), terminal_(::isatty(STDERR_FILENO) == 1) {}

Console::~Console() {
    clear();
}

void Console::progress(size_t done) const {
    if (!terminal_) {
        return;
    }
    constexpr size_t kWidth = 30;
    const size_t filled = kWidth * done / std::max<size_t>(total_, 1);
    std::fprintf(stderr, "\r\033[K[%s%s] %s %zu of %zu", std::string(filled, '#').c_str(),
                 std::string(kWidth - filled, '.').c_str(), what_.c_str(),
                 std::min(done + 1, total_), total_);
}

void Console::note(const std::string& text) const {
    clear();
    std::fprintf(stderr, "ecir: %s\n", text.c_str());
}

void Console::clear() const {
    if (terminal_) {
        std::fputs("\r\033[K", stderr);
    }
}

} // namespace ecir::cli
