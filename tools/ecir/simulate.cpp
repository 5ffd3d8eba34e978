#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <unistd.h>
#include <vector>

#include "runtime/error.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/image_files.hpp"
#include "tools/ecir/resize.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/file.hpp"
#include "tools/io/image.hpp"
#include "tools/io/npy.hpp"
#include "tools/io/output.hpp"
#include "tools/simulate/esim.hpp"
#include "tools/simulate/motion.hpp"
#include "tools/simulate/recording.hpp"
#include "tools/simulate/scene.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
    fs::path input;
    fs::path output;
    std::string size = "240x180";
    PixelSize pixels; ///< of `size`
    int64_t exposure_us = 120'000;
    int64_t start_us = 0;
    int count = 1;
    int frames = 14;
    double fps = 0;
    int bits = 8;
    std::string path = "linear"; ///< a key of `paths`
    sim::Motion motion;
    std::vector<double> thresholds{0.18};
    sim::CameraModel camera;
    uint64_t seed = 1;
    bool overwrite = false;
};

const std::map<std::string, sim::Path> paths{
    {"linear", sim::Path::linear}, {"reverse", sim::Path::reverse}, {"shake", sim::Path::shake}};

[[noreturn]] void refuse(const std::string& message) {
    throw Error(ExitCode::usage, message);
}

/// Checks what concerns several options, and fills in what follows from them.
void settle(Options& options) {
    options.pixels = parse_size(options.size);
    constexpr int smallest = 16;
    if (std::min(options.pixels.width, options.pixels.height) < smallest) {
        refuse("--size " + options.size + ": frames have at least 16 pixels a side");
    }
    constexpr int64_t latest = 4'000'000'000'000'000'000; // recordings are read up to there
    if (options.exposure_us > (latest - options.start_us) / options.count) {
        refuse("--start, --exposure-us and --count lead past the end of the events' clock");
    }
    options.motion.path = paths.at(options.path);
    options.camera.positive = options.thresholds.front();
    options.camera.negative = options.thresholds.back();
    options.camera.seed = options.motion.seed = options.seed;
}

/// A folder is a video, a file a still.
std::unique_ptr<sim::Scene> open_scene(const Options& options, bool still,
                                       nlohmann::ordered_json& record) {
    const auto exposure = static_cast<double>(options.exposure_us);
    if (still) {
        auto scene = std::make_unique<sim::StillScene>(
            io::read_image(options.input), options.motion, options.pixels.width,
            options.pixels.height, exposure, options.count, std::max(1, options.frames - 1));
        record["sub_frames"] = scene->sub_frames();
        return scene;
    }
    std::vector<fs::path> files = image_files(options.input, false);
    if (files.size() < 2) {
        throw Error(ExitCode::bad_input,
                    options.input.string() + ": holds fewer than two images (.png, .jpg or .tif)");
    }
    const size_t available = files.size();
    auto scene = std::make_unique<sim::FrameScene>(std::move(files), options.fps,
                                                   options.pixels.width, options.pixels.height);
    const double needed = exposure * options.count;
    // Half a microsecond for frame rates that do not divide a second.
    if (scene->end_us() + 0.5 < needed) {
        throw Error(ExitCode::bad_input, options.input.string() + ": its " +
                                             std::to_string(available) + " frames last " +
                                             std::to_string(scene->end_us() / 1e3) +
                                             " ms, the exposures " + std::to_string(needed / 1e3) +
                                             " ms; give more frames, or less --exposure-us or "
                                             "--count");
    }
    return scene;
}

std::string numbered(const char* prefix, int index) {
    char text[64];
    std::snprintf(text, sizeof text, "%s%06d", prefix, index);
    return text;
}

void write_text(const fs::path& path, const std::string& text) {
    io::write_file(path, {{reinterpret_cast<const uint8_t*>(text.data()), text.size()}});
}

void write_truth(const fs::path& folder, const Options& options, int index, sim::Shot& shot) {
    fs::path place = folder / "truth";
    if (options.count > 1) {
        place /= numbered("", index);
    }
    fs::create_directories(place);
    std::vector<float> all;
    for (size_t i = 0; i < shot.truth.size(); ++i) {
        io::Image& frame = shot.truth[i];
        frame.bits = options.bits;
        io::write_image(place / (numbered("", static_cast<int>(i)) + ".png"), frame);
        if (options.count == 1) {
            all.insert(all.end(), frame.pixels.begin(), frame.pixels.end());
        }
    }
    if (options.count > 1) {
        return;
    }
    std::vector<size_t> shape{shot.truth.size(), static_cast<size_t>(options.pixels.height),
                              static_cast<size_t>(options.pixels.width)};
    if (shot.blurry.channels == 3) {
        shape.push_back(3);
    }
    io::write_npy(folder / "truth.npy", shape, all);
}

void describe(const Options& options, bool still, nlohmann::ordered_json& record) {
    record["input"] = options.input.filename().string();
    record["size"] = {options.pixels.width, options.pixels.height};
    record["start_us"] = options.start_us;
    record["exposure_us"] = options.exposure_us;
    record["count"] = options.count;
    record["frames"] = options.frames;
    record["bits"] = options.bits;
    record["seed"] = options.seed;
    if (still) {
        record["motion"] = {{"path", options.path},
                            {"travel_px", options.motion.travel_px},
                            {"angle_deg", options.motion.angle_deg},
                            {"rotate_deg", options.motion.rotate_deg},
                            {"zoom", options.motion.zoom}};
    } else {
        record["fps"] = options.fps;
    }
    record["camera"] = {{"threshold_positive", options.camera.positive},
                        {"threshold_negative", options.camera.negative},
                        {"threshold_sigma", options.camera.sigma},
                        {"log_offset", sim::log_offset},
                        {"refractory_us", options.camera.refractory_us},
                        {"noise_hz", options.camera.noise_hz},
                        {"hot_fraction", options.camera.hot_fraction},
                        {"hot_hz", options.camera.hot_hz}};
}

void run(Options& options) {
    settle(options);
    std::error_code ignored;
    const bool still = !fs::is_directory(options.input, ignored);
    if (still && options.fps > 0) {
        refuse("--fps is for a folder of frames; " + options.input.string() + " is not one");
    }
    if (!still && !(options.fps > 0)) {
        refuse("a folder of frames needs --fps, their number a second of exposure");
    }

    if (io::lies_within(options.input, options.output)) {
        refuse(options.output.string() + " holds the input; choose another output");
    }

    nlohmann::ordered_json record;
    describe(options, still, record);
    io::PendingOutput output(options.output, true, options.overwrite);
    const auto scene = open_scene(options, still, record);
    sim::EventCamera camera(options.camera, options.pixels.width, options.pixels.height);
    std::string exposures = "file,start_us,end_us\n";
    const bool terminal = isatty(STDERR_FILENO) != 0;
    for (int i = 0; i < options.count; ++i) {
        if (terminal) {
            std::cerr << "\rexposure " << i + 1 << " of " << options.count << std::flush;
        }
        const sim::Window window{i * options.exposure_us, (i + 1) * options.exposure_us};
        sim::Shot shot = sim::expose(*scene, camera, window, options.frames);
        shot.blurry.bits = options.bits;
        const std::string name = numbered("blurry_", i) + ".png";
        io::write_image(output.path() / name, shot.blurry);
        write_truth(output.path(), options, i, shot);
        exposures += name + "," + std::to_string(options.start_us + window.start_us) + "," +
                     std::to_string(options.start_us + window.end_us) + "\n";
    }
    if (terminal) {
        std::cerr << '\n';
    }
    const Events events = camera.take(options.start_us);
    io::write_events(output.path() / "events.h5", events.view());
    record["events"] = events.size();
    write_text(output.path() / "exposures.csv", exposures);
    write_text(output.path() / "simulation.json",
               record.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
    output.commit();
    std::cout << options.output.string() << ": exposures " << options.count
              << ", sharp frames in each " << options.frames << ", events " << events.size()
              << '\n';
}

void add_scene_options(CLI::App& command, Options& options) {
    command.add_option("--size", options.size, "Frame size WxH; the input is cropped and averaged")
        ->capture_default_str();
    command.add_option("--exposure-us", options.exposure_us, "Exposure, microseconds")
        ->check(CLI::Range(int64_t{1}, int64_t{107'374'182}))
        ->capture_default_str();
    command.add_option("--start", options.start_us, "The events' clock at the start, microseconds")
        ->check(CLI::Range(int64_t{0}, int64_t{4'000'000'000'000'000'000}))
        ->capture_default_str();
    command
        .add_option("--count", options.count,
                    "Exposures, one right after another; the motion goes on")
        ->check(CLI::Range(1, 10'000))
        ->capture_default_str();
    command
        .add_option("--frames", options.frames,
                    "Sharp frames an exposure, evenly from its start to its end; 1: its middle")
        ->check(CLI::Range(1, 10'000))
        ->capture_default_str();
    command.add_option("--bits", options.bits, "Depth of the images written")
        ->check(CLI::IsMember({8, 16}))
        ->capture_default_str();
    command.add_option("--fps", options.fps,
                       "Frames a second of a folder of frames. Between them the light is taken as "
                       "linear in time; video interpolated to 960 or more a second beforehand "
                       "gives truer events");
}

void add_motion_options(CLI::App& command, Options& options) {
    std::vector<CLI::Option*> all;
    all.push_back(command
                      .add_option("--motion", options.path,
                                  "Of a still: linear, reverse (turns back once an exposure) or "
                                  "shake (a hand's, random by the seed)")
                      ->check(CLI::IsMember({"linear", "reverse", "shake"})));
    all.push_back(command.add_option("--travel", options.motion.travel_px,
                                     "Length of the way in an exposure, pixels"));
    all.push_back(command.add_option("--angle", options.motion.angle_deg,
                                     "Its direction, degrees: 0 right, 90 down"));
    all.push_back(command.add_option("--rotate", options.motion.rotate_deg,
                                     "Rotation in an exposure, degrees clockwise"));
    all.push_back(
        command.add_option("--zoom", options.motion.zoom, "Magnification in an exposure"));
    for (CLI::Option* option : all) {
        option->capture_default_str()->group("Motion")->excludes("--fps");
    }
}

void add_camera_options(CLI::App& command, Options& options) {
    const std::string group = "Event camera";
    command
        .add_option("--threshold", options.thresholds,
                    "Contrast threshold C+, and C- where it differs (its size, positive)")
        ->expected(1, 2)
        ->capture_default_str()
        ->group(group);
    command.add_option("--threshold-sigma", options.camera.sigma, "Spread of both, event by event")
        ->capture_default_str()
        ->group(group);
    command
        .add_option("--refractory", options.camera.refractory_us,
                    "A pixel's dead time after an event, microseconds")
        ->capture_default_str()
        ->group(group);
    command.add_option("--noise", options.camera.noise_hz, "Background events a second and pixel")
        ->capture_default_str()
        ->group(group);
    command
        .add_option("--hot", options.camera.hot_fraction, "Share of pixels that fire on their own")
        ->capture_default_str()
        ->group(group);
    command.add_option("--hot-rate", options.camera.hot_hz, "Events a second of such a pixel")
        ->capture_default_str()
        ->group(group);
    command
        .add_option("--seed", options.seed,
                    "Of thresholds, noise, and where a shake or reversal goes")
        ->capture_default_str();
}

} // namespace

void add_simulate(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command = app.add_subcommand(
        "simulate", "Make a blurry frame, its events and the sharp truth from a still or a video");
    command
        ->add_option("-i,--input", options->input,
                     "A picture that will be moved, or a folder of sharp frames")
        ->required();
    command->add_option("-o,--output", options->output, "The folder to make")->required();
    add_scene_options(*command, *options);
    add_motion_options(*command, *options);
    add_camera_options(*command, *options);
    command->add_flag("--overwrite", options->overwrite, "Replace an existing output");
    command->footer(
        "The output is a recording that deblur takes with -i: exposures.csv, blurry_NNNNNN.png,\n"
        "events.h5; beside them the truth (truth/NNNNNN.png and truth.npy, or one folder in "
        "truth/\n"
        "for each of several exposures) and simulation.json with every parameter.\n"
        "\n"
        "Examples:\n"
        "  ecir simulate -i still.png -o scene --travel 12 --angle 30 --noise 0.1\n"
        "  ecir simulate -i frames -o scene --fps 960 --exposure-us 50000 --count 10");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli
