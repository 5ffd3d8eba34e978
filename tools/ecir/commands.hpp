#pragma once
#include <CLI/CLI.hpp>

namespace ecir::cli {

// One subcommand a file. Each adds its options to the program; when it is chosen it runs inside
// App::parse and throws ecir::Error where it cannot go on.
void add_deblur(CLI::App& app);
void add_eval(CLI::App& app);
void add_simulate(CLI::App& app);
void add_verify(CLI::App& app);
void add_bench(CLI::App& app);
void add_chart(CLI::App& app);
void add_devices(CLI::App& app);

} // namespace ecir::cli
