#pragma once
#include <filesystem>
#include <string>

namespace ecir::io {

/// An output file or folder that appears under its final name only when complete: it is written
/// under a temporary name beside it and renamed by commit(); without commit() it is removed.
class PendingOutput {
public:
    /// Refuses an existing target (exit 2) unless `overwrite`; checks that the parent can be
    /// written (exit 3). With `folder`, the temporary folder exists after construction. Overwriting
    /// replaces a file by a file and a folder by a folder, the latter only if it is empty or looks
    /// like an output (frames.csv in it or in all its folders, or simulation.json). A device or a
    /// pipe cannot be replaced: with `overwrite` it is written directly.
    PendingOutput(std::filesystem::path target, bool folder, bool overwrite);
    ~PendingOutput();
    PendingOutput(const PendingOutput&) = delete;
    PendingOutput& operator=(const PendingOutput&) = delete;

    /// Where to write meanwhile. Keeps the target's extension, so that writers can go by it.
    [[nodiscard]] const std::filesystem::path& path() const { return temporary_; }
    /// Replaces the target by what was written. Throws Error when that fails.
    void commit();

private:
    void create_temporary();
    void remove_temporary() noexcept;

    std::filesystem::path target_;
    std::filesystem::path temporary_;
    bool folder_;
    bool overwrite_;
    bool direct_ = false;
    bool committed_ = false;
};

/// From now on SIGINT, SIGTERM, SIGHUP and SIGQUIT remove every pending output before they end the
/// process; SIGPIPE and SIGXFSZ are ignored. Call once.
void install_cleanup_handler();

} // namespace ecir::io
