#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "layers/deblur.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/chart_measure.hpp"
#include "tools/ecir/chart_svg.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/io/file.hpp"
#include "tools/io/output.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
    fs::path scenes;
    fs::path output;
    std::vector<std::string> models;
    uint32_t most_refine = 4;
    std::vector<Precision> precisions = {Precision::float32};
    std::string device;
    bool overwrite = false;
    bool json = false;
};

nlohmann::ordered_json report(const std::vector<ChartPoint>& points, const DeviceInfo& device,
                              const std::vector<ChartScene>& scenes) {
    const ChartScene& first = scenes.front();
    nlohmann::ordered_json rows = points;
    const auto front = pareto_front(points, &ChartPoint::ms, &ChartPoint::psnr);
    for (size_t i = 0; i < points.size(); ++i) {
        rows[i]["front"] = static_cast<bool>(front[i]);
    }
    return {
        {"device", device.name},
        {"driver", device.driver},
        {"size", std::to_string(first.blurry.width) + "x" + std::to_string(first.blurry.height)},
        {"frames", first.truth.size()},
        {"scenes", scenes.size()},
        {"points", rows}};
}

void print_table(const std::vector<ChartPoint>& points) {
    const auto front = pareto_front(points, &ChartPoint::ms, &ChartPoint::psnr);
    std::printf("  %-28s %8s %8s %10s %10s\n", "", "PSNR, dB", "SSIM", "ms", "GFLOP");
    for (size_t i = 0; i < points.size(); ++i) {
        const ChartPoint& point = points[i];
        std::printf("%c %-28s %8.2f %8.4f %10.1f %10.2f\n", front[i] ? '*' : ' ',
                    point.name().c_str(), point.psnr, point.ssim, point.ms, point.gflop);
    }
    std::printf("* nothing faster has a higher PSNR\n");
}

void write_text(const fs::path& path, const std::string& text) {
    io::write_file(path, {std::span(reinterpret_cast<const uint8_t*>(text.data()), text.size())});
}

void run(const Options& options) {
    const auto scenes = read_chart_scenes(options.scenes);
    std::optional<io::PendingOutput> output;
    if (!options.output.empty()) {
        output.emplace(options.output, true, options.overwrite);
    }
    std::map<Precision, std::shared_ptr<Device>> devices;
    for (const Precision precision : options.precisions) {
        devices[precision] = open_device(options.device, precision);
    }
    std::vector<Precision> precisions;
    precisions.reserve(devices.size());
    for (const auto& [precision, device] : devices) {
        precisions.push_back(precision);
    }
    std::vector<std::string> models = options.models;
    if (models.empty()) {
        models = model_names();
        models.emplace_back("auto");
    }
    auto points = chart_configurations(models, options.most_refine, precisions);
    {
        Console console("configuration", points.size());
        for (size_t i = 0; i < points.size(); ++i) {
            console.progress(i);
            measure(points[i], devices.at(points[i].precision), scenes);
        }
    }
    const auto all = report(points, devices.begin()->second->info(), scenes);
    if (options.json) {
        std::printf("%s\n", all.dump(2).c_str());
    } else {
        print_table(points);
    }
    if (output) {
        write_text(output->path() / "chart.json", all.dump(2) + "\n");
        write_text(output->path() / "chart.csv", to_csv(points));
        const std::string where =
            all["device"].get<std::string>() + ", " + all["size"].get<std::string>() + ", " +
            std::to_string(scenes.front().truth.size()) + " frames an exposure, " +
            std::to_string(scenes.size()) + (scenes.size() == 1 ? " scene" : " scenes");
        write_text(output->path() / "chart.svg",
                   chart_svg(points, "Accuracy against time and operations", where));
        output->commit();
    }
}

} // namespace

void add_chart(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command =
        app.add_subcommand("chart", "Chart accuracy against time and operations on this device");
    command
        ->add_option("--scenes", options->scenes,
                     "A folder of recordings of one exposure with their truth")
        ->required()
        ->option_text("DIR (required)");
    command
        ->add_option("-o,--output", options->output,
                     "A new folder for chart.svg, chart.csv and chart.json")
        ->option_text("DIR");
    command->add_flag("--overwrite", options->overwrite, "Replace an existing output");
    add_models_option(*command, options->models);
    command
        ->add_option("--most-refine", options->most_refine,
                     "Chart E-CIR with 0 to so many iterations of its refinement")
        ->check(CLI::Range(1, 20))
        ->option_text("N [4]");
    add_precision_option(*command, options->precisions, 2);
    add_device_option(*command, options->device);
    command->add_flag("--json", options->json, "Print as JSON");
    command->footer(
        "Every model at full and half size (enlarged again to be compared), networks also without\n"
        "their refinement. Models compute the whole image; `auto`, at each --quality of deblur, "
        "what\n"
        "moves. Times are means over the scenes, for a blurry frame in steady state.\n"
        "Scenes come from `ecir simulate` or tools/train/simulate.py.\n"
        "\n"
        "Example:\n"
        "  ecir chart --scenes scenes -o chart");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli
