#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <fcntl.h>
#include <iostream>
#include <new>
#include <poll.h>
#include <string>
#include <unistd.h>
#include <vector>

#include "runtime/error.hpp"
#include "runtime/instance.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/io/output.hpp"

namespace {

/// The arguments in CLI11's order, last first, with -.5 as -0.5: else it is taken for an option.
std::vector<std::string> reversed(int argc, char** argv) {
    std::vector<std::string> all(argv + 1, argv + argc);
    for (std::string& argument : all) {
        if (argument.size() > 2 && argument.starts_with("-.") && argument[2] >= '0' &&
            argument[2] <= '9') {
            argument.insert(1, "0");
        }
    }
    std::reverse(all.begin(), all.end());
    return all;
}

[[noreturn]] void refuse(const CLI::App& app, const CLI::ParseError& error) {
    const auto unknown = app.remaining();
    if (app.get_subcommands().empty() && !unknown.empty()) {
        throw ecir::Error(ecir::ExitCode::usage,
                          "no subcommand '" + unknown.front() + "'; see ecir --help");
    }
    std::string command = "ecir";
    for (const CLI::App* chosen : app.get_subcommands()) {
        command += " " + chosen->get_name();
    }
    throw ecir::Error(ecir::ExitCode::usage,
                      std::string(error.what()) + "; see " + command + " --help");
}

int run(int argc, char** argv) {
    CLI::App app{
        "A motion-blurred frame and an event camera's events to a sharp, continuous video."};
    app.name("ecir");
    app.set_version_flag("--version", std::string("ecir ") + ECIR_VERSION);
    app.require_subcommand(1);
    app.footer(
        "Example: a scene, its sharp video, and how close it is to the truth\n"
        "  ecir simulate -i still.png -o scene --travel 20\n"
        "  ecir deblur -i scene -o sharp\n"
        "  ecir eval --truth scene/truth --prediction sharp\n"
        "\n"
        "Exit codes: 0 done, 1 a check failed, 2 wrong usage, 3 bad input, 4 no usable device,\n"
        "5 out of memory or disk.");
    ecir::cli::add_deblur(app);
    ecir::cli::add_simulate(app);
    ecir::cli::add_eval(app);
    ecir::cli::add_verify(app);
    ecir::cli::add_bench(app);
    ecir::cli::add_chart(app);
    ecir::cli::add_stability(app);
    ecir::cli::add_info(app);
    ecir::cli::add_devices(app);
    if (argc == 1) {
        std::fputs(app.help().c_str(), stderr);
        return static_cast<int>(ecir::ExitCode::usage);
    }
    try {
        app.parse(reversed(argc, argv));
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() != 0) {
            refuse(app, error);
        }
        app.exit(error); // --help, --version
    }
    std::cout.flush();
    if (std::fflush(stdout) != 0 || std::ferror(stdout) != 0 || !std::cout) {
        pollfd out{STDOUT_FILENO, 0, 0};
        if (::poll(&out, 1, 0) == 1 && (out.revents & POLLERR) != 0) { // as `| head` expects
            (void)std::signal(SIGPIPE, SIG_DFL);
            (void)std::raise(SIGPIPE);
        }
        throw ecir::Error(ecir::ExitCode::resources,
                          "cannot write to standard output; is its disk full?");
    }
    return 0;
}

/// One line, whatever a library put into its message.
int fail(ecir::ExitCode code, std::string message) {
    std::replace(message.begin(), message.end(), '\n', ' ');
    std::fflush(stdout);
    std::fprintf(stderr, "ecir: %s\n", message.c_str());
    return static_cast<int>(code);
}

/// A file that got the number of a closed stream would get what is printed there.
void occupy_standard_streams() {
    for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
        if (::fcntl(stream, F_GETFD) == -1) {
            (void)::open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY); // still fails
        }
    }
}

} // namespace

int main(int argc, char** argv) {
    occupy_standard_streams();
    ecir::io::install_cleanup_handler();
    int code = 0;
    try {
        code = run(argc, argv);
    } catch (const ecir::Error& error) {
        code = fail(error.code(), error.what());
    } catch (const std::bad_alloc&) {
        code = fail(ecir::ExitCode::resources,
                    "out of memory; use a smaller --size or fewer --frames");
    } catch (const std::exception& error) {
        code = fail(ecir::ExitCode::bad_input, error.what());
    }
    if (code == 0 && !ecir::validation_messages().empty()) {
        return fail(ecir::ExitCode::device, "the Vulkan validation layer reported problems");
    }
    return code;
}
