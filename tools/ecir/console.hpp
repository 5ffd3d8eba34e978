#pragma once
#include <cstddef>
#include <string>

namespace ecir::cli {

/// What a subcommand tells on stderr while it works: a progress line, only on a terminal, and whole
/// lines that do not run into it.
class Console {
public:
    /// `what` is counted up to `total`, such as "exposure".
    Console(std::string what, size_t total);
    ~Console();
    Console(const Console&) = delete;
    Console& operator=(const Console&) = delete;

    void progress(size_t done) const;
    void note(const std::string& text) const;
    void warn(const std::string& text) const { note("warning: " + text); }

private:
    void clear() const;

    std::string what_;
    size_t total_;
    bool terminal_;
};

} // namespace ecir::cli
