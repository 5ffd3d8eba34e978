#pragma once
#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "tools/ecir/precision.hpp"

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
void add_info(CLI::App& app);

/// -g of every subcommand that works on a device.
inline CLI::Option* add_device_option(CLI::App& command, std::string& device) {
    return command
        .add_option("-g,--device", device, "Its index or a part of its name (ecir devices)")
        ->option_text("DEVICE");
}

/// --precision: up to `most` values.
inline CLI::Option* add_precision_option(CLI::App& command, std::vector<Precision>& precisions,
                                         int most) {
    return command
        .add_option_function<std::vector<std::string>>(
            "--precision",
            [&precisions](const std::vector<std::string>& names) {
                precisions.clear();
                for (const std::string& name : names) {
                    precisions.push_back(name == "float16" ? Precision::float16
                                                           : Precision::float32);
                }
            },
            "What convolutions multiply in; float16 is for GPUs, sums stay float32")
        ->check(CLI::IsMember({"float32", "float16"}))
        ->expected(1, most)
        ->option_text(most > 1 ? "float32 float16 [float32]" : "float32|float16 [float32]");
}

/// `-m` of a subcommand that compares models.
inline CLI::Option* add_models_option(CLI::App& command, std::vector<std::string>& models) {
    return command.add_option("-m,--models", models, "Models, .safetensors files, edi")
        ->option_text("MODEL ... [all that are shipped]");
}

} // namespace ecir::cli
