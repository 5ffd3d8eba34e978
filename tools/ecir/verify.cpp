#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "runtime/error.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/operation_choice.hpp"

namespace ecir::cli {
namespace {

struct Options {
    std::string operation;
    std::string device;
    bool json = false;
};

void run(const Options& options) {
    const auto chosen = choose_operations(options.operation);
    const auto device = Device::open(options.device);
    auto rows = nlohmann::json::array();
    size_t failed = 0;
    if (!options.json) {
        std::printf("%s (%s, %s)\n", device->info().name.c_str(), device->info().type.c_str(),
                    device->info().driver.c_str());
    }
    for (const Operation* operation : chosen) {
        if (!runs_on(*operation, device->info())) {
            if (!options.json) {
                std::printf("left out %s, which needs float16\n",
                            std::string(operation->name).c_str());
            }
            continue;
        }
        for (uint32_t trial = 0; trial < operation->trials; ++trial) {
            const TrialResult result = run_trial(*operation, *device, trial);
            failed += result.ok ? 0 : 1;
            rows.push_back({{"name", operation->name},
                            {"shape", result.shape},
                            {"error", std::isfinite(result.error) ? nlohmann::json(result.error)
                                                                  : nlohmann::json()},
                            {"tolerance", operation->tolerance},
                            {"reason", operation->reason},
                            {"ok", result.ok}});
            if (!options.json) {
                std::printf("%-6s %-18s %-44s error %8.1e  tolerance %7.1e\n",
                            result.ok ? "ok" : "FAILED", std::string(operation->name).c_str(),
                            result.shape.c_str(), result.error, operation->tolerance);
                std::fflush(stdout);
            }
        }
    }
    if (options.json) {
        const nlohmann::json all = {
            {"device", device->info().name}, {"driver", device->info().driver}, {"ops", rows}};
        std::printf("%s\n", all.dump(2).c_str());
    } else {
        std::printf("%zu of %zu cases within tolerance\n", rows.size() - failed, rows.size());
    }
    if (failed > 0) {
        throw Error(ExitCode::check_failed,
                    std::to_string(failed) + " of " + std::to_string(rows.size()) +
                        " cases differ from their reference on " + device->info().name);
    }
}

} // namespace

void add_verify(CLI::App& app) {
    auto* command = app.add_subcommand(
        "verify", "Run every kernel and compare it with its double-precision CPU reference");
    auto options = std::make_shared<Options>();
    command
        ->add_option("--op", options->operation,
                     "Only operations in whose names this regular expression is found")
        ->option_text("REGEX");
    add_device_option(*command, options->device);
    command->add_flag("--json", options->json, "Print as JSON");
    command->footer("Exits with 1 when a case is outside its tolerance.\n"
                    "\n"
                    "Example:\n"
                    "  ecir verify --op 'conv|curve' -g 0 --json");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli
