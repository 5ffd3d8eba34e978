#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace ecir::cli {

// One subcommand a file. Each adds its options to the program; when it is chosen it runs inside
// App::parse and throws ecir::Error where it cannot go on.
void add_deblur(CLI::App& app);
void add_eval(CLI::App& app);
void add_simulate(CLI::App& app);
void add_verify(CLI::App& app);
void add_bench(CLI::App& app);
void add_chart(CLI::App& app);
void add_stability(CLI::App& app);
void add_devices(CLI::App& app);

/// -g of every subcommand that works on a device.
inline CLI::Option* add_device_option(CLI::App& command, std::string& device) {
    return command
        .add_option("-g,--device", device, "Its index or a part of its name (ecir devices)")
        ->option_text("DEVICE");
}

/// `-m` of a subcommand that compares models.
inline CLI::Option* add_models_option(CLI::App& command, std::vector<std::string>& models) {
    return command.add_option("-m,--models", models, "Models, .safetensors files, edi")
        ->option_text("MODEL ... [all that are shipped]");
}

} // namespace ecir::cli
