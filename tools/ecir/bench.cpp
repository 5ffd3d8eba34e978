#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <regex>
#include <string>
#include <vector>

#include "layers/conv.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/bench_compare.hpp"
#include "tools/ecir/bench_models.hpp"
#include "tools/ecir/bench_operations.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/console.hpp"
#include "tools/ecir/operation_choice.hpp"

namespace ecir::cli {
namespace {

struct Options {
    std::string operation;
    ModelCase model;
    std::string size;
    std::vector<Precision> precision;
    bool start = false;
    std::filesystem::path compare;
    std::string device;
    bool json = false;
    bool explain = false;

    /// Neither is asked for: everything is.
    [[nodiscard]] bool everything() const { return operation.empty() && model.model.empty(); }
};

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::usage, what);
}

std::vector<ModelCase> chosen_models(const Options& options, bool sized) {
    std::vector<std::string> names;
    if (!options.model.model.empty()) {
        names = {options.model.model};
    } else if (options.everything()) {
        names = model_names();
    } else if (options.start || options.model.refine || sized) {
        refuse("--size, --frames, --refine, --precision and --start are about models; give "
               "--model too");
    }
    if (options.model.refine && names.size() != 1) {
        refuse("--refine is about one model; give --model too");
    }
    std::vector<ModelCase> models;
    for (const std::string& name : names) {
        if (name != "edi") {
            (void)find_model(name); // a mistake there shows before anything runs
        }
        models.push_back(options.model);
        models.back().model = name;
    }
    return models;
}

std::vector<OperationRow> bench_operations(Device& device, const Roof& roof,
                                           const std::string& choice) {
    auto chosen = choose_operations(choice);
    std::erase_if(chosen, [&](const Operation* each) { return !runs_on(*each, device.info()); });
    uint32_t total = 0;
    for (const Operation* operation : chosen) {
        total += operation->network_trials;
    }
    const Console console("operation", total);
    std::vector<OperationRow> rows;
    for (const Operation* operation : chosen) {
        for (uint32_t i = 0; i < operation->network_trials; ++i) {
            console.progress(rows.size());
            rows.push_back(bench_operation(*operation, device, operation->trials + i, roof));
        }
    }
    return rows;
}

std::vector<ModelRow> bench_models(const std::shared_ptr<Device>& device,
                                   const std::vector<ModelCase>& models, bool start) {
    const Console console("model", models.size());
    std::vector<ModelRow> rows;
    for (const ModelCase& model : models) {
        console.progress(rows.size());
        rows.push_back(bench_model(device, model));
        if (start && rows.back().ok) {
            rows.back().start = bench_start(device->info(), model, rows.back().time.median_ms);
        }
    }
    return rows;
}

/// Throws Error(check_failed) for wrong results, then for regressions.
void judge(const BenchReport& report, const std::optional<OldReport>& old,
           const std::vector<ComparedRow>& compared) {
    const auto wrong = std::ranges::count(report.operations, false, &OperationRow::ok) +
                       std::ranges::count(report.models, false, &ModelRow::ok);
    if (wrong > 0) {
        throw Error(ExitCode::check_failed, std::to_string(wrong) + " results are wrong on " +
                                                report.device.name + ", so were not timed");
    }
    const auto slower = std::ranges::count(compared, true, &ComparedRow::regression);
    if (slower > 0) {
        const auto worst = std::ranges::max_element(
            compared, {}, [](const ComparedRow& row) { return row.regression ? row.ratio() : 0; });
        char ratio[32];
        std::snprintf(ratio, sizeof ratio, "%.2f", worst->ratio());
        throw Error(ExitCode::check_failed,
                    std::to_string(slower) + " of " + std::to_string(compared.size()) +
                        " rows take longer than in " + old->path().string() +
                        " beyond the noise; the worst: " + worst->what + ", " + ratio + " times");
    }
}

void run(const Options& options, bool sized) {
    const auto models = chosen_models(options, sized);
    std::optional<OldReport> old;
    if (!options.compare.empty()) {
        old.emplace(options.compare);
    }
    const bool operations = !options.operation.empty() || options.everything();
    if (operations) {
        (void)choose_operations(options.operation); // a mistake there shows before anything runs
    }
    const auto device = Device::open(options.device);
    // Operations have a precision of their own each, whatever the models' is.
    const auto for_models = options.model.precision == Precision::float32
                                ? device
                                : open_device(options.device, options.model.precision);
    if (options.explain) {
        std::fputs((device->info().name + "\n" + explain_convolutions(device->info())).c_str(),
                   stdout);
        return;
    }
    if (old && old->device() != device->info().name) {
        Console("", 0).warn(old->path().string() + " is of another device, " + old->device());
    }
    BenchReport report{this_host(),
                       device->info(),
                       options.model.precision,
                       measure_roof(*device),
                       measure_overhead(*device),
                       {},
                       {}};
    if (!options.json) {
        print_surroundings(report);
    }
    if (operations) {
        report.operations = bench_operations(*device, report.roof, options.operation);
        if (!options.json) {
            print_operations(report.operations);
        }
    }
    if (!models.empty()) {
        report.models = bench_models(for_models, models, options.start || options.everything());
        if (!options.json) {
            print_models(report.models);
        }
    }
    std::vector<ComparedRow> compared;
    if (old) {
        compared = old->compare(report);
    }
    if (options.json) {
        auto json = to_json(report);
        if (old) {
            json["compared"] = to_json(compared);
        }
        std::printf("%s\n", json.dump(2).c_str());
    } else if (old) {
        print_comparison(*old, compared);
    }
    judge(report, old, compared);
}

void add_model_options(CLI::App& command, Options& o) {
    const std::string group = "Models";
    command
        .add_option("-m,--model", o.model.model,
                    "Time this one: fusion, ecir, edi, or a .safetensors file")
        ->option_text("MODEL")
        ->group(group);
    command.add_option("--size", o.size, "Pixels of the frame, 240x180 unless given")
        ->option_text("WxH")
        ->group(group);
    command.add_option("--frames", o.model.frames, "Wanted frames, 14 unless given")
        ->check(CLI::Range(1U, 1'000'000U))
        ->option_text("D")
        ->group(group);
    command.add_option("--refine", o.model.refine, "Iterations of its refinement, else as trained")
        ->check(CLI::Range(0U, 1000U))
        ->option_text("I")
        ->group(group);
    add_precision_option(command, o.precision, 1)->group(group);
    command
        .add_flag("--start", o.start,
                  "Also its start-up (takes a minute; without --op and --model always done)")
        ->group(group);
}

} // namespace

void add_bench(CLI::App& app) {
    auto* command = app.add_subcommand(
        "bench", "Time every kernel and whole models, and what share of the device they reach");
    auto options = std::make_shared<Options>();
    command
        ->add_option("--op", options->operation,
                     "Time only operations in whose names this regular expression is found")
        ->option_text("REGEX");
    add_model_options(*command, *options);
    command
        ->add_option("--compare", options->compare,
                     "A report that bench --json wrote: print ratios, exit with 1 on a regression")
        ->option_text("FILE");
    add_device_option(*command, options->device);
    command->add_flag("--json", options->json, "Print as JSON");
    command->add_flag("--explain", options->explain,
                      "Only say which kernels convolutions use on this device, and why");
    command->footer(
        "Without --op and --model: all operations at the shapes of the shipped networks (240x180,\n"
        "14 frames), and all shipped models with their start-up; a few minutes on a CPU driver.\n"
        "Every result is checked before it is timed; a wrong one is exit 1.\n"
        "  ms        median over 20 runs and 0.3 s (5 runs and 3 s of what is slow); of an\n"
        "            operation by the device's timestamps, of a model from an image and 100,000\n"
        "            events in host memory to frames in host memory\n"
        "  stream    the same of a model where one blurry frame after the other comes: the next\n"
        "            one begins before one is finished\n"
        "  spread    from the first quartile of the runs to the third\n"
        "  share     of the roof, by arithmetic or by memory, whichever is larger; the roof is\n"
        "            the best of a multiply-add kernel and of a copy kernel in the same run; what\n"
        "            stays in caches can pass that of memory\n"
        "  overhead  an empty submission with its wait; one more small dispatch with a barrier\n"
        "  start-up  runs of ecir deblur, start to end, with caches of their own: with empty\n"
        "            ones; again, and what of that is not the frame's own time; what a size that\n"
        "            the caches do not know adds\n"
        "A regression takes over 10 % longer than in FILE, and three quarters of its runs take "
        "longer\n"
        "than three quarters of those did.\n"
        "\n"
        "Examples:\n"
        "  ecir bench --json > before.json\n"
        "  ecir bench --op conv --compare before.json\n"
        "  ecir bench --model ecir --size 240x180 --frames 14 --refine 3");
    command->callback([options, command] {
        if (!options->size.empty()) {
            options->model.size = parse_size(options->size);
        }
        if (!options->precision.empty()) {
            options->model.precision = options->precision.front();
        }
        run(*options,
            command->count("--size") + command->count("--frames") + command->count("--precision") >
                0);
    });
}

} // namespace ecir::cli
