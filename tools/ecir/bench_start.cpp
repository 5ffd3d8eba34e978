#include <algorithm>
#include <array>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <spawn.h>
#include <string>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

#include "runtime/error.hpp"
#include "tools/ecir/bench_models.hpp"
#include "tools/ecir/precision.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/file.hpp"
#include "tools/io/image.hpp"
#include "tools/io/output.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

std::vector<char*> pointers(std::vector<std::string>& texts) {
    std::vector<char*> result;
    result.reserve(texts.size() + 1);
    for (std::string& text : texts) {
        result.push_back(text.data());
    }
    result.push_back(nullptr);
    return result;
}

/// This process's environment with caches in a folder.
std::vector<std::string> environment_with_caches(const fs::path& folder) {
    constexpr std::array kCaches = {"ECIR_CACHE_DIR=", "XDG_CACHE_HOME=", "MESA_SHADER_CACHE_DIR=",
                                    "MESA_GLSL_CACHE_DIR=", "__GL_SHADER_DISK_CACHE_PATH="};
    std::vector<std::string> result;
    for (char** entry = environ; *entry != nullptr; ++entry) {
        const std::string_view text = *entry;
        if (std::ranges::none_of(kCaches,
                                 [&](const char* cache) { return text.starts_with(cache); })) {
            result.emplace_back(text);
        }
    }
    for (const char* cache : kCaches) {
        result.push_back(cache + folder.string());
    }
    return result;
}

/// Runs this program with its standard output thrown away. Throws the Error that it ends with.
void run_self(std::vector<std::string> arguments, const fs::path& folder) {
    arguments.insert(arguments.begin(), "ecir");
    auto environment = environment_with_caches(folder / "cache");
    const fs::path messages = folder / "messages";
    posix_spawn_file_actions_t actions{};
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, messages.c_str(),
                                     O_WRONLY | O_CREAT | O_TRUNC, 0600);
    pid_t child = 0;
    const int failed = ::posix_spawn(&child, "/proc/self/exe", &actions, nullptr,
                                     pointers(arguments).data(), pointers(environment).data());
    posix_spawn_file_actions_destroy(&actions);
    if (failed != 0) {
        throw io::system_error(failed, "/proc/self/exe", "cannot run");
    }
    int status = 0;
    while (::waitpid(child, &status, 0) == -1 && errno == EINTR) {
    }
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) {
        return;
    }
    std::string last;
    std::ifstream in(messages);
    for (std::string line; std::getline(in, line);) {
        last = line;
    }
    throw Error(WIFEXITED(status) ? static_cast<ExitCode>(WEXITSTATUS(status)) : ExitCode::device,
                "a run of ecir deblur for --start failed; its last message: " + last);
}

/// Deblurs scenes of `work` in runs of their own.
class Runs {
public:
    Runs(const DeviceInfo& device, const ModelCase& work)
        : folder_(fs::temp_directory_path() / ("ecir-bench-" + std::to_string(::getpid())), true,
                  false),
          device_(device), work_(work) {}

    /// Writes the scene of a size; its index.
    size_t add(const PixelSize& size) {
        const BenchScene scene(size);
        const std::string name = std::to_string(scenes_++);
        io::write_image(path(name + ".png"), scene.blurry);
        io::write_events(path(name + ".h5"), scene.events.view());
        exposure_ = scene.exposure;
        return scenes_ - 1;
    }

    /// Seconds that a run on it takes, from its start to its end.
    double operator()(size_t scene) {
        const std::string name = std::to_string(scene);
        std::vector<std::string> arguments = {"deblur",
                                              "-i",
                                              path(name + ".png"),
                                              "-e",
                                              path(name + ".h5"),
                                              "--exposure",
                                              std::to_string(exposure_.start),
                                              std::to_string(exposure_.end),
                                              "-o",
                                              path("frames.npy"),
                                              "--overwrite",
                                              "-m",
                                              work_.model,
                                              "--frames",
                                              std::to_string(work_.frames),
                                              "-g",
                                              std::to_string(device_.index)};
        if (work_.refine) {
            arguments.insert(arguments.end(), {"--refine", std::to_string(*work_.refine)});
        }
        if (work_.precision != Precision::float32) {
            arguments.insert(arguments.end(), {"--precision", precision_name(work_.precision)});
        }
        const double start = now_ms();
        run_self(std::move(arguments), folder_.path());
        return (now_ms() - start) / 1000;
    }

    /// The median of three.
    double typical(size_t scene) {
        std::array<double, 3> seconds{};
        for (double& one : seconds) {
            one = (*this)(scene);
        }
        std::ranges::sort(seconds);
        return seconds[1];
    }

private:
    [[nodiscard]] std::string path(const std::string& name) const {
        return (folder_.path() / name).string();
    }

    io::PendingOutput folder_; ///< never committed, so it is removed, also by a signal
    const DeviceInfo& device_;
    const ModelCase& work_;
    Exposure exposure_;
    size_t scenes_ = 0;
};

} // namespace

StartTimes bench_start(const DeviceInfo& device, const ModelCase& work, double steady_ms) {
    Runs run(device, work);
    const size_t scene = run.add(work.size);
    // From 240x180 to 346x260, the sizes of two common sensors.
    const PixelSize other{work.size.width * 13 / 9, work.size.height * 13 / 9};
    const size_t other_scene = run.add(other);
    StartTimes times;
    times.first_run_s = run(scene);
    times.second_run_s = run.typical(scene);
    times.second_start_s = std::max(0.0, times.second_run_s - steady_ms / 1000);
    times.new_size = std::to_string(other.width) + "x" + std::to_string(other.height);
    const double fresh = run(other_scene);
    times.new_size_s = std::max(0.0, fresh - run.typical(other_scene));
    return times;
}

} // namespace ecir::cli
