#include "tools/io/output.hpp"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <fcntl.h>
#include <mutex>
#include <string_view>
#include <sys/stat.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

/// Every temporary that exists now, for removal on a signal.
struct Registry {
    std::mutex mutex;
    std::vector<fs::path> paths;
};

Registry& registry() {
    // Never destroyed: the signal thread may outlive static objects.
    static auto* const all = new Registry;
    return *all;
}

void forget(const fs::path& path) {
    std::erase(registry().paths, path);
}

void remove_everything() {
    const std::scoped_lock lock(registry().mutex);
    for (const auto& path : registry().paths) {
        std::error_code problem;
        // A thread that still writes may add a file meanwhile.
        for (int attempt = 0; attempt < 3; ++attempt) {
            fs::remove_all(path, problem);
            if (!problem) {
                break;
            }
        }
    }
}

/// The signal's number goes through this pipe from the handler, which may only write, to a thread
/// that may remove files. A blocked mask with sigwait() would not do: a library that starts threads
/// while it is loaded (OpenBLAS) leaves some where the signal is not blocked.
int g_signal_pipe[2] = {-1, -1};

void on_signal(int number) {
    const auto byte = static_cast<char>(number);
    (void)!::write(g_signal_pipe[1], &byte, 1);
}

void await_signal() {
    char byte = 0;
    while (::read(g_signal_pipe[0], &byte, 1) != 1) {
        if (errno != EINTR) {
            return;
        }
    }
    remove_everything();
    // Ends the process the way the signal would have, so that a shell sees it.
    (void)std::signal(byte, SIG_DFL);
    (void)::raise(byte);
}

[[noreturn]] void refuse(const fs::path& target, const std::string& why) {
    throw Error(ExitCode::usage, target.string() + ": " + why);
}

bool has_frames_list(const fs::path& folder) {
    std::error_code ignored;
    return fs::is_regular_file(folder / "frames.csv", ignored);
}

/// Whether a folder holds what this tool writes, so that somebody's home is not replaced.
bool looks_like_output(const fs::path& folder) {
    std::error_code problem;
    if (has_frames_list(folder) || fs::is_regular_file(folder / "simulation.json", problem) ||
        fs::is_regular_file(folder / "chart.json", problem) ||
        fs::is_regular_file(folder / "stability.json", problem)) {
        return true;
    }
    const fs::directory_iterator entries(folder, problem);
    return !problem && std::all_of(fs::begin(entries), fs::end(entries), [](const auto& entry) {
        return entry.is_directory() && has_frames_list(entry.path());
    });
}

void check_replaceable(const fs::path& target, const fs::file_status& status, bool folder) {
    if (fs::is_directory(status) != folder) {
        refuse(target, folder ? "exists and is not a folder; choose another output"
                              : "exists and is a folder, not a file; choose another output");
    }
    if (!folder) {
        return;
    }
    std::error_code problem;
    const fs::path here = fs::current_path(problem);
    if (!problem && lies_within(here, target)) {
        refuse(target, "is the working folder or holds it; choose another output");
    }
    if (!looks_like_output(target)) {
        refuse(
            target,
            "is not replaced, since it does not look like an output (neither empty nor "
            "with frames.csv, simulation.json, chart.json or stability.json in it); remove it or "
            "choose another output");
    }
}

fs::path hidden_name(const fs::path& target, const std::string& purpose) {
    static std::atomic<unsigned> counter{0};
    // Short enough for the suffix to fit into the 255 bytes of a name.
    const std::string stem = target.stem().string().substr(0, 180);
    return target.parent_path() /
           ("." + stem + "." + purpose + "-" + std::to_string(::getpid()) + "-" +
            std::to_string(counter++) + target.extension().string().substr(0, 30));
}

} // namespace

PendingOutput::PendingOutput(fs::path target, bool folder, bool overwrite)
    : target_(std::move(target)), folder_(folder), overwrite_(overwrite) {
    if (target_.empty()) {
        refuse(target_, "the output's name is empty; give a file or folder");
    }
    target_ = fs::absolute(target_).lexically_normal();
    if (!target_.has_filename()) {
        target_ = target_.parent_path(); // "out/"
    }
    if (!target_.has_filename()) {
        refuse(target_, "this is not a name for an output; choose another");
    }
    std::error_code problem;
    if (fs::is_symlink(target_, problem)) {
        // What the link leads to is replaced, not the link; a pipe (/dev/stdout) has no name.
        const bool leads = fs::exists(target_, problem);
        fs::path led = leads ? fs::canonical(target_, problem)
                             : target_.parent_path() / fs::read_symlink(target_, problem);
        target_ = problem ? target_ : std::move(led);
    }
    const fs::file_status status = fs::status(target_, problem);
    if (fs::exists(status)) {
        if (!overwrite_) {
            refuse(target_, "exists already; give --overwrite or choose another output");
        }
        check_replaceable(target_, status, folder_);
        direct_ = !folder_ && !fs::is_regular_file(status);
    }
    create_temporary();
}

PendingOutput::~PendingOutput() {
    if (!committed_ && !direct_) {
        remove_temporary();
    }
}

void PendingOutput::create_temporary() {
    if (direct_) {
        temporary_ = target_;
        return;
    }
    temporary_ = hidden_name(target_, "partial");
    const std::scoped_lock lock(registry().mutex);
    registry().paths.reserve(registry().paths.size() + 1);
    const int made =
        folder_ ? ::mkdir(temporary_.c_str(), 0777)
                : ::open(temporary_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (made < 0) {
        throw system_error(errno, target_, "cannot create");
    }
    if (!folder_) {
        ::close(made);
    }
    registry().paths.push_back(temporary_);
}

void PendingOutput::remove_temporary() noexcept {
    const std::scoped_lock lock(registry().mutex);
    std::error_code ignored;
    fs::remove_all(temporary_, ignored);
    forget(temporary_);
}

void PendingOutput::commit() {
    if (direct_) {
        return;
    }
    fs::path old;
    {
        // Held throughout, so that a signal finds either the old target or the new one.
        const std::scoped_lock lock(registry().mutex);
        std::error_code problem;
        if (fs::exists(target_, problem)) {
            if (!overwrite_) {
                refuse(target_,
                       "has appeared meanwhile; give --overwrite or choose another output");
            }
            if (folder_) {
                old = hidden_name(target_, "old");
                if (::rename(target_.c_str(), old.c_str()) != 0) {
                    throw system_error(errno, target_, "cannot move the old folder aside");
                }
            }
        }
        if (::rename(temporary_.c_str(), target_.c_str()) != 0) {
            const int error_number = errno;
            if (!old.empty()) {
                fs::rename(old, target_, problem);
            }
            throw system_error(error_number, target_, "cannot put the output in place");
        }
        committed_ = true;
        forget(temporary_);
        if (!old.empty()) {
            registry().paths.push_back(old);
        }
    }
    if (!old.empty()) {
        std::error_code ignored;
        fs::remove_all(old, ignored);
        const std::scoped_lock lock(registry().mutex);
        forget(old);
    }
}

void install_cleanup_handler() {
    if (::pipe(g_signal_pipe) != 0) {
        throw system_error(errno, "a pipe", "cannot open");
    }
    std::thread(await_signal).detach();
    // As errors where they happen, EPIPE and EFBIG, so that nothing half-written stays.
    (void)std::signal(SIGPIPE, SIG_IGN);
    (void)std::signal(SIGXFSZ, SIG_IGN);
    for (const int number : {SIGINT, SIGTERM, SIGHUP, SIGQUIT}) {
        struct sigaction now {};
        // A signal ignored from outside (nohup) stays ignored.
        if (::sigaction(number, nullptr, &now) == 0 && now.sa_handler != SIG_IGN) {
            struct sigaction handler {};
            handler.sa_handler = on_signal;
            handler.sa_flags = SA_RESTART;
            ::sigaction(number, &handler, nullptr);
        }
    }
}

} // namespace ecir::io
