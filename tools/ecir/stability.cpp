#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <regex>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/console.hpp"
#include "tools/ecir/image_files.hpp"
#include "tools/io/file.hpp"
#include "tools/io/image.hpp"
#include "tools/io/output.hpp"
#include "tools/stability/run.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
    fs::path output;
    std::string sweep = ".*";
    std::vector<std::string> models;
    std::vector<fs::path> images;
    std::string device;
    bool quick = false;
    bool list = false;
    bool overwrite = false;
    bool json = false;
};

std::vector<stability::Sweep> chosen_sweeps(const std::string& pattern) {
    std::vector<stability::Sweep> chosen;
    try {
        const std::regex regex(pattern);
        for (stability::Sweep& sweep : stability::all_sweeps()) {
            if (std::regex_search(sweep.name, regex)) {
                chosen.push_back(std::move(sweep));
            }
        }
    } catch (const std::regex_error& error) {
        throw Error(ExitCode::usage,
                    "--sweep '" + pattern + "' is no regular expression: " + error.what());
    }
    if (chosen.empty()) {
        throw Error(ExitCode::usage,
                    "no sweep matches '" + pattern + "'; ecir stability --list names them");
    }
    return chosen;
}

/// The pictures that are moved; two seeds of the camera and motion where there is but one.
std::vector<stability::Subject> subjects_of(const Options& options) {
    std::vector<fs::path> files;
    for (const fs::path& given : options.images) {
        std::error_code error;
        if (fs::is_directory(given, error)) {
            const auto below = image_files(given, false);
            files.insert(files.end(), below.begin(), below.end());
        } else {
            files.push_back(given);
        }
    }
    if (files.empty()) {
        files.emplace_back(ECIR_SAMPLE_STILL);
        std::error_code error;
        if (!fs::exists(files.front(), error)) {
            throw Error(ExitCode::usage, "the source tree's sample, " + files.front().string() +
                                             ", is not there; give pictures with --images");
        }
        if (!options.quick) {
            files.push_back(files.front());
        }
    }
    std::vector<stability::Subject> subjects;
    for (const fs::path& file : files) {
        stability::Subject subject;
        subject.picture = io::read_image(file);
        subject.picture.pixels = io::luminance(subject.picture);
        subject.picture.channels = 1;
        subject.seed = subjects.size() + 1;
        if (options.quick) {
            subject.width = 48;
            subject.height = 40;
            subject.frames = 3;
        }
        subjects.push_back(std::move(subject));
    }
    return subjects;
}

void write_text(const fs::path& path, const std::string& text) {
    io::write_file(path, {std::span(reinterpret_cast<const uint8_t*>(text.data()), text.size())});
}

void print_table(const std::vector<stability::Result>& results) {
    for (const stability::Result& result : results) {
        std::printf("%s: %s\n  %s\n", result.sweep.name.c_str(), result.sweep.title.c_str(),
                    result.sweep.x.label.c_str());
        std::printf("  %-34s", "");
        for (size_t i = 0; i < result.values.size(); ++i) {
            std::printf(" %9s", result.label(i).c_str());
        }
        std::printf("\n");
        for (const std::string& series : result.series()) {
            std::printf("  %-34s", series.c_str());
            for (size_t i = 0; i < result.values.size(); ++i) {
                const stability::Sample* sample = result.find(i, series);
                if (sample == nullptr) {
                    std::printf(" %9s ", "");
                } else {
                    std::printf(" %8.4g%c", sample->value, sample->failed ? '*' : ' ');
                }
            }
            std::printf("\n");
        }
        std::printf("  * fails: %s\n", result.sweep.fails.c_str());
    }
}

void run(const Options& options) {
    const auto sweeps = chosen_sweeps(options.sweep);
    if (options.list) {
        for (const stability::Sweep& sweep : sweeps) {
            std::printf("%-26s %s\n", sweep.name.c_str(), sweep.title.c_str());
        }
        return;
    }
    std::unique_ptr<io::PendingOutput> output;
    if (!options.output.empty()) {
        output = std::make_unique<io::PendingOutput>(options.output, true, options.overwrite);
    }
    stability::Lab lab;
    lab.subjects = subjects_of(options);
    lab.device = Device::open(options.device);
    lab.methods = stability::methods_of(options.models.empty() ? model_names() : options.models);

    size_t total = 0;
    for (const stability::Sweep& sweep : sweeps) {
        total += options.quick ? sweep.quick.size() : sweep.values.size();
    }
    std::vector<stability::Result> results;
    {
        Console console("condition", total);
        size_t before = 0;
        for (const stability::Sweep& sweep : sweeps) {
            results.push_back(stability::run(
                sweep, lab, options.quick, [&](size_t done) { console.progress(before + done); }));
            before += results.back().values.size();
        }
    }

    const stability::Subject& subject = lab.subjects.front();
    const std::string where = lab.device->info().name + ", " + std::to_string(subject.width) + "x" +
                              std::to_string(subject.height) + ", " +
                              std::to_string(subject.frames) +
                              " frames, scenes: " + std::to_string(lab.subjects.size());
    nlohmann::ordered_json report = {
        {"device", lab.device->info().name},
        {"driver", lab.device->info().driver},
        {"size", std::to_string(subject.width) + "x" + std::to_string(subject.height)},
        {"frames", subject.frames},
        {"scenes", lab.subjects.size()}};
    size_t broken = 0;
    for (const stability::Result& result : results) {
        report["sweeps"].push_back(to_json(result));
        for (const std::string& text : result.broken()) {
            std::fprintf(stderr, "not safe: %s\n", text.c_str());
            ++broken;
        }
    }
    if (options.json) {
        std::printf("%s\n", report.dump(2).c_str());
    } else {
        print_table(results);
    }
    if (output) {
        for (const stability::Result& result : results) {
            write_text(output->path() / (result.sweep.name + ".svg"), line_chart(result, where));
        }
        write_text(output->path() / "stability.json", report.dump(1) + "\n");
        write_text(output->path() / "README.md", markdown(results, where));
        output->commit();
    }
    if (broken > 0) {
        throw Error(ExitCode::check_failed,
                    std::to_string(broken) + " conditions are not met as safely as promised");
    }
}

} // namespace

void add_stability(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command = app.add_subcommand(
        "stability", "Sweep conditions from mild to severe: where each method begins to fail");
    command
        ->add_option("-o,--output", options->output,
                     "A new folder for README.md, stability.json and a chart a sweep")
        ->option_text("DIR");
    command->add_flag("--overwrite", options->overwrite, "Replace an existing output");
    command->add_option("--sweep", options->sweep, "Only sweeps whose names have a match")
        ->option_text("REGEX");
    command->add_flag("--list", options->list, "Name the sweeps and end");
    command->add_flag("--quick", options->quick, "Few values, small frames: a check in seconds");
    add_models_option(*command, options->models);
    command
        ->add_option("--images", options->images,
                     "Pictures that are moved, or folders of them, a scene each")
        ->option_text("PATH ... [the source tree's sample, twice]");
    add_device_option(*command, options->device);
    command->add_flag("--json", options->json, "Print as JSON");
    command->footer(
        "Exits with 1 where a method fails within the range in which it is promised not to, or\n"
        "gives a value that is not finite.\n"
        "\n"
        "Examples:\n"
        "  ecir stability --quick\n"
        "  ecir stability -o stability --sweep 'sensor|motion'");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli
