#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <memory>
#include <string>

#include "runtime/error.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/deblur_job.hpp"
#include "tools/io/file.hpp"

namespace ecir::cli {
namespace {

/// The options as they were typed.
struct Options {
    DeblurJob job;
    std::vector<std::string> exposure;
    std::vector<size_t> only;
    std::vector<double> thresholds;
    uint32_t frames = 14;
    double fps = 0;
    std::vector<double> times;
    std::string size;
    std::string lag;
    std::string regions = "on";
    std::string order = "full";
    std::string quality;
    std::vector<Precision> precision = {Precision::float32};
};

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::usage, what);
}

/// Whole microseconds, also written as 1.6e15, of an option.
int64_t parse_time(const std::string& option, const std::string& text) {
    const char* const end = text.data() + text.size();
    constexpr int64_t kLatest = 4'000'000'000'000'000'000; // keeps durations within int64
    int64_t time = 0;
    const auto whole = std::from_chars(text.data(), end, time);
    if (whole.ec == std::errc() && whole.ptr == end) {
        if (time < -kLatest || time > kLatest) {
            refuse(option + " '" + text + "' is beyond 4e18 microseconds");
        }
        return time;
    }
    constexpr double kExact = 9007199254740992; // 2^53: whole numbers up to there are doubles
    double real = 0;
    const auto other = std::from_chars(text.data(), end, real);
    if (other.ec != std::errc() || other.ptr != end || !(std::abs(real) <= kExact) ||
        real != std::floor(real)) {
        refuse(option + " '" + text + "' is not a time in whole microseconds");
    }
    return static_cast<int64_t>(real);
}

/// A name that looks like a file of a kind that is not written here must not become a folder.
void check_output(const std::filesystem::path& output) {
    constexpr std::array kOthers{".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp",  ".gif",
                                 ".mov", ".m4v", ".webm", ".npz", ".h5",   ".hdf5", ".csv"};
    const std::string extension = io::lower_extension(output);
    if (std::find(kOthers.begin(), kOthers.end(), extension) != kOthers.end()) {
        refuse(output.string() + ": " + extension +
               " is not written; give a folder, a video (.mp4, .mkv, .avi) or an array (.npy)");
    }
}

DeblurJob to_job(const Options& options) {
    DeblurJob job = options.job;
    check_output(job.output);
    for (const double time : options.times) {
        if (!(time >= -1 && time <= 1)) {
            refuse(
                "--times takes normalised times within [-1, 1], -1 the start of the exposure and 1 "
                "its end");
        }
    }
    if (options.fps > 0) {
        job.fps = options.fps;
    } else {
        job.times = options.times.empty() ? even_times(options.frames) : options.times;
    }
    if (!options.exposure.empty()) {
        job.exposure = Exposure{parse_time("--exposure", options.exposure[0]),
                                parse_time("--exposure", options.exposure[1])};
    }
    if (!options.only.empty()) {
        job.only = {options.only.front(), options.only.back()};
        if (job.only->second < job.only->first) {
            refuse("--only takes the first exposure, then the last, counted from 0");
        }
    }
    if (!options.thresholds.empty()) {
        job.deblur.thresholds = {static_cast<float>(options.thresholds.front()),
                                 static_cast<float>(options.thresholds.back())};
    }
    if (options.lag == "auto") {
        job.lag.reset();
    } else if (!options.lag.empty()) {
        job.lag = parse_time("--lag", options.lag);
    }
    job.precision = options.precision.front();
    job.deblur.regions = options.regions == "on";
    job.deblur.ordered = options.order == "events";
    if (job.deblur.model != "auto" && (job.budget_ms || !options.quality.empty())) {
        refuse("--quality and --budget choose between models; leave them out, or -m " +
               job.deblur.model);
    }
    if (options.quality == "fast") {
        job.deblur.quality = Quality::fast;
    } else if (options.quality == "balanced") {
        job.deblur.quality = Quality::balanced;
    }
    if (!options.size.empty()) {
        job.size = parse_size(options.size);
    }
    return job;
}

/// CLI11's own range lets NaN through.
CLI::Validator within(double least, double most) {
    return {[=](std::string& text) {
                double value = 0;
                const bool number = CLI::detail::lexical_cast(text, value);
                return number && value >= least && value <= most
                           ? std::string()
                           : "'" + text + "' is not a number from " +
                                 CLI::detail::to_string(least) + " to " +
                                 CLI::detail::to_string(most);
            },
            ""};
}

void add_input(CLI::App& command, Options& o) {
    const std::string group = "Input";
    command
        .add_option("-i,--input", o.job.input,
                    "The blurry image, or a recording: a folder, or an AEDAT 4 file")
        ->required()
        ->option_text("PATH (required)")
        ->group(group);
    command
        .add_option(
            "-e,--events", o.job.events,
            "The image's events: HDF5 (DSEC's layout), AEDAT 4, Prophesee's RAW or DAT, or text")
        ->option_text("FILE")
        ->group(group);
    command
        .add_option("--exposure", o.exposure, "Of the image, on the events' clock, microseconds")
        ->expected(2)
        ->option_text("START END")
        ->group(group);
    command
        .add_option("--only", o.only,
                    "Of a recording: only this exposure, or these, counted from 0")
        ->expected(1, 2)
        ->option_text("FIRST [LAST]")
        ->group(group);
    command
        .add_option(
            "--lag", o.lag,
            "Of the events behind the frames, microseconds; auto: estimated from what moves "
            "during the first exposures")
        ->option_text("US|auto [0]")
        ->group(group);
    command
        .add_option("--size", o.size,
                    "Work at this smaller size: the image is averaged, events are scaled")
        ->option_text("WxH")
        ->group(group);
}

void add_times(CLI::App& command, Options& o) {
    const std::string group = "Times of the sharp frames (one of)";
    auto* frames =
        command.add_option("--frames", o.frames, "Evenly from start to end; 1: the middle")
            ->check(within(1, 1e6))
            ->option_text("N [14]")
            ->group(group);
    auto* fps = command.add_option("--fps", o.fps, "As many a second of exposure")
                    ->check(within(1e-6, 1e12))
                    ->option_text("F")
                    ->excludes(frames)
                    ->group(group);
    command.add_option("--times", o.times, "-1 (start) to 1 (end), in any order")
        ->option_text("T1 [T2 ...]")
        ->excludes(frames)
        ->excludes(fps)
        ->group(group);
}

void add_method(CLI::App& command, Options& o) {
    const std::string group = "Method";
    command
        .add_option("-m,--model", o.job.deblur.model,
                    "A shipped model, a .safetensors file, edi, or auto: the smallest fusion "
                    "network that the scene needs")
        ->option_text("MODEL [" + o.job.deblur.model + "]")
        ->group(group);
    command
        .add_option("--quality", o.quality,
                    "Of auto: best loses up to 0.1 dB against the largest network, balanced 0.5")
        ->check(CLI::IsMember({"fast", "balanced", "best"}))
        ->option_text("fast|balanced|best [best]")
        ->group(group);
    command
        .add_option("--budget", o.job.budget_ms,
                    "Of auto: no model that takes longer for a blurry frame on this device, "
                    "milliseconds")
        ->check(within(1e-3, 1e9))
        ->option_text("MS")
        ->group(group);
    command
        .add_option(
            "--refine", o.job.deblur.refine,
            "Refinement iterations of E-CIR; fusion networks: 0 the prior alone, 1 corrected, "
            "2 averaged along the motion too")
        ->check(within(0, 1000))
        ->option_text("N [all]")
        ->group(group);
    command
        .add_option("--refine-until", o.job.deblur.refine_until,
                    "Of E-CIR: end the refinement after an iteration that changed no pixel by so "
                    "many grey levels of 255, and beyond the trained iterations where changes no "
                    "longer fall; 0: never")
        ->check(within(0, 255))
        ->option_text("LEVELS [0.25]")
        ->group(group);
    command
        .add_option("--order", o.order,
                    "Of E-CIR's curve: as many as the events that a pixel and its neighbours have, "
                    "or full everywhere")
        ->check(CLI::IsMember({"events", "full"}))
        ->option_text("events|full [" + o.order + "]")
        ->group(group);
    command
        .add_option("--keypoints", o.job.deblur.keypoints, "Must be what the model was trained for")
        ->option_text("N")
        ->group(group);
    command
        .add_option("--threshold", o.thresholds,
                    "Of edi and fusion networks: contrast thresholds, else estimated")
        ->expected(1, 2)
        ->check(within(0.001, 10))
        ->option_text("C+ [C-]")
        ->group(group);
    command
        .add_option("--regions", o.regions,
                    "Compute only what moves; off: all of the image, to the same frames")
        ->check(CLI::IsMember({"on", "off"}))
        ->option_text("on|off [" + o.regions + "]")
        ->group(group);
    add_precision_option(command, o.precision, 1)->group(group);
    add_device_option(command, o.job.device)->group(group);
}

} // namespace

void add_deblur(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command =
        app.add_subcommand("deblur", "Turn a blurry frame and its events into sharp frames");
    add_input(*command, *options);
    command
        ->add_option("-o,--output", options->job.output,
                     "A folder, a video (.mp4, .mkv, .avi) or an array (.npy)")
        ->required()
        ->option_text("PATH (required)")
        ->group("Output");
    command->add_flag("--overwrite", options->job.overwrite, "Replace an existing output")
        ->group("Output");
    command
        ->add_option("--report", options->job.report,
                     "JSON: what was found in each exposure, warnings, what was used, times")
        ->check([](const std::string& name) {
            return std::string(name.empty() ? "the name is empty; give a file" : "");
        })
        ->option_text("FILE")
        ->group("Output");
    add_times(*command, *options);
    add_method(*command, *options);
    command->footer("A folder gets 000000.png, ... at the image's depth, and frames.csv with their "
                    "times; a video\n"
                    "plays 25 frames a second; an array holds float32, frames x height x width [x "
                    "3], not clipped.\n"
                    "A recording is a folder with images, one events file and exposures.csv\n"
                    "(file,start_us,end_us), or an AEDAT 4 file with frames and events; its "
                    "exposures' frames\n"
                    "are numbered on.\n"
                    "\n"
                    "Examples:\n"
                    "  ecir deblur -i blurry.png -e events.h5 --exposure 1600000000000000 "
                    "1600000000050000 -o out\n"
                    "  ecir deblur -i recording -o sharp.mp4 --frames 30\n"
                    "  ecir deblur -i recording -o middle.npy --times 0 -m edi --threshold 0.2");
    command->callback([options] { run_deblur(to_job(*options)); });
}

} // namespace ecir::cli
