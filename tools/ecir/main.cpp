#include <cstdio>
#include <exception>
#include <new>

#include "runtime/error.hpp"
#include "runtime/instance.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/io/output.hpp"

namespace {

int run(int argc, char** argv) {
    CLI::App app{"A motion-blurred frame and an event camera's events to a sharp, continuous video."};
    app.name("ecir");
    app.set_version_flag("--version", std::string("ecir ") + ECIR_VERSION);
    app.require_subcommand(1);
    ecir::cli::add_deblur(app);
    ecir::cli::add_simulate(app);
    ecir::cli::add_eval(app);
    ecir::cli::add_verify(app);
    ecir::cli::add_devices(app);
    try {
        app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
        const bool asked = error.get_exit_code() == 0; // --help, --version
        app.exit(error);
        return static_cast<int>(asked ? ecir::ExitCode::ok : ecir::ExitCode::usage);
    }
    return 0;
}

int fail(ecir::ExitCode code, const char* message) {
    std::fprintf(stderr, "ecir: %s\n", message);
    return static_cast<int>(code);
}

} // namespace

int main(int argc, char** argv) {
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
