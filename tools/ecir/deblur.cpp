#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <unistd.h>

#include "layers/deblur.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/commands.hpp"
#include "tools/ecir/frame_output.hpp"
#include "tools/ecir/resize.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/recording.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
    fs::path input;
    fs::path events;
    std::vector<int64_t> exposure;
    fs::path output;
    DeblurOptions deblur;
    std::vector<float> thresholds;
    uint32_t frames = 14;
    double fps = 0;
    std::vector<double> times;
    std::string device;
    std::string size;
    bool overwrite = false;
};

constexpr double kVideoFps = 25; ///< of written videos: slow enough to see what moves

[[noreturn]] void refuse(const std::string& what) { throw Error(ExitCode::usage, what); }

/// The wanted times of one exposure, normalised.
std::vector<double> wanted_times(const Options& options, const Exposure& exposure) {
    if (!options.times.empty()) {
        return options.times;
    }
    if (options.fps <= 0) {
        return even_times(options.frames);
    }
    const double seconds = static_cast<double>(exposure.duration()) * 1e-6;
    constexpr double kSlack = 1e-9; // the last frame of 0.1 s at 100 fps belongs to it
    const auto count = static_cast<size_t>(std::floor(seconds * options.fps + kSlack)) + 1;
    std::vector<double> times(count);
    for (size_t i = 0; i < count; ++i) {
        times[i] = std::min(1.0, -1 + 2 * static_cast<double>(i) / options.fps / seconds);
    }
    return times;
}

io::Recording one_frame(const Options& options) {
    if (options.events.empty() || options.exposure.empty()) {
        refuse("a single frame needs its events (-e FILE) and its exposure (--exposure START END); "
               "a recording is a folder with exposures.csv");
    }
    const Exposure exposure{options.exposure[0], options.exposure[1]};
    if (exposure.end <= exposure.start) {
        throw Error(ExitCode::bad_input, "--exposure ends at " + std::to_string(exposure.end) +
                                             ", not after its start " +
                                             std::to_string(exposure.start) +
                                             "; give START END in microseconds");
    }
    return {{{options.input, exposure}}, options.events};
}

io::Recording open_input(const Options& options) {
    std::error_code ignored;
    if (!fs::is_directory(options.input, ignored)) {
        return one_frame(options);
    }
    if (!options.events.empty() || !options.exposure.empty()) {
        refuse("-e and --exposure go with a single frame; a recording's folder holds both");
    }
    return io::open_recording(options.input);
}

/// A window wholly outside what the file recorded is a mistake in the clock, not a still scene.
void check_exposure(const Exposure& exposure, const EventView& events, const fs::path& file) {
    if (events.size() == 0 || (exposure.start <= events.t.back() && events.t.front() <= exposure.end)) {
        return;
    }
    throw Error(ExitCode::bad_input,
                file.string() + ": the exposure " + std::to_string(exposure.start) + " to " +
                    std::to_string(exposure.end) + " lies wholly outside the events, which run from " +
                    std::to_string(events.t.front()) + " to " + std::to_string(events.t.back()) +
                    " us; are both on one clock?");
}

void check_sizes(const io::EventFile& events, const io::Image& image, const fs::path& image_path,
                 const fs::path& events_path) {
    if (events.width && events.height &&
        (*events.width != image.width || *events.height != image.height)) {
        throw Error(ExitCode::bad_input,
                    events_path.string() + " is of a " + std::to_string(*events.width) + "x" +
                        std::to_string(*events.height) + " sensor, but " + image_path.string() +
                        " has " + std::to_string(image.width) + "x" + std::to_string(image.height) +
                        " pixels; both must be of one sensor");
    }
    io::check_inside(events.events.view(), image.width, image.height, events_path);
}

/// A line on stderr that is written over, and only on a terminal.
class Progress {
public:
    explicit Progress(size_t total) : total_(total), shown_(isatty(STDERR_FILENO) == 1) {}
    ~Progress() {
        if (shown_) {
            std::fputs("\r\033[K", stderr);
        }
    }
    Progress(const Progress&) = delete;
    Progress& operator=(const Progress&) = delete;
    void show(size_t done) const {
        if (!shown_) {
            return;
        }
        constexpr size_t kWidth = 30;
        const size_t filled = kWidth * done / std::max<size_t>(total_, 1);
        std::fprintf(stderr, "\rdeblur [%s%s] exposure %zu of %zu", std::string(filled, '#').c_str(),
                     std::string(kWidth - filled, '.').c_str(), done, total_);
    }

private:
    size_t total_;
    bool shown_;
};

/// Deblurs the exposures of a recording one after another into one output.
class Run {
public:
    explicit Run(const Options& options)
        : options_(options), recording_(open_input(options)),
          output_(options.output, options.overwrite, count_frames(), kVideoFps) {}

    void operator()() {
        const io::EventFile file = io::read_events(recording_.events);
        for (const auto& item : recording_.items) {
            check_exposure(item.exposure, file.events.view(), recording_.events);
        }
        device_ = Device::open(options_.device);
        if (device_->info().is_cpu && options_.device.empty()) {
            std::fprintf(stderr, "ecir: no GPU found, using the CPU driver %s (ecir devices lists all)\n",
                         device_->info().name.c_str());
        }
        Progress progress(recording_.items.size());
        for (size_t i = 0; i < recording_.items.size(); ++i) {
            progress.show(i);
            exposure(recording_.items[i], file);
        }
        progress.show(recording_.items.size());
        output_.commit();
    }

private:
    [[nodiscard]] size_t count_frames() const {
        size_t count = 0;
        for (const auto& item : recording_.items) {
            count += wanted_times(options_, item.exposure).size();
        }
        return count;
    }

    void exposure(const io::Recording::Item& item, const io::EventFile& file) {
        io::Image image = io::read_image(item.image);
        check_sizes(file, image, item.image, recording_.events);
        const EventView seen = window(file.events.view(), item.exposure);
        if (seen.size() == 0) {
            std::fprintf(stderr, "ecir: warning: %s: no event in its exposure; its frames are the "
                                 "blurry frame\n",
                         item.image.c_str());
        }
        Events scaled;
        EventView events = seen;
        if (!options_.size.empty()) {
            const PixelSize size = parse_size(options_.size);
            scaled = scale_events(seen, image.width, image.height, size);
            events = scaled.view();
            image = resize_area(image, size);
        }
        prepare(image, item.image);

        const std::vector<double> times = wanted_times(options_, item.exposure);
        const std::vector<float> luminance = to_luminance(image);
        const auto frames = deblur_->frames(luminance, events, item.exposure, times);
        if (const auto used = deblur_->thresholds(); used && options_.thresholds.empty()) {
            std::fprintf(stderr, "ecir: %s: estimated thresholds %.3f %.3f\n", item.image.c_str(),
                         static_cast<double>(used->positive), static_cast<double>(used->negative));
        }
        const std::span<const float> all = frames;
        for (size_t i = 0; i < times.size(); ++i) {
            const auto frame = all.subspan(i * luminance.size(), luminance.size());
            io::Image sharp = image;
            if (image.channels == 1) {
                sharp.pixels.assign(frame.begin(), frame.end());
            } else {
                sharp.pixels = recolour(image.pixels, luminance, frame, 3);
            }
            output_.add(sharp, {{}, times[i], io::absolute_time(item.exposure, times[i])});
        }
    }

    /// One Deblur object serves all exposures, so all images have one size.
    void prepare(const io::Image& image, const fs::path& path) {
        const PixelSize size{image.width, image.height};
        if (deblur_ && (size.width != size_.width || size.height != size_.height)) {
            throw Error(ExitCode::bad_input, path.string() + " has another size than the image before it; "
                                                             "a recording has one sensor");
        }
        if (!deblur_) {
            size_ = size;
            deblur_.emplace(device_, options_.deblur, static_cast<uint32_t>(size.width),
                            static_cast<uint32_t>(size.height));
        }
    }

    const Options& options_;
    io::Recording recording_;
    FrameOutput output_;
    std::shared_ptr<Device> device_;
    std::optional<Deblur> deblur_;
    PixelSize size_{};
};

void run(Options& options) {
    for (const double time : options.times) {
        if (!(time >= -1 && time <= 1)) {
            refuse("--times takes normalised times within [-1, 1]");
        }
    }
    if (!options.thresholds.empty()) {
        options.deblur.thresholds = {options.thresholds.front(), options.thresholds.back()};
    }
    if (!options.size.empty()) {
        parse_size(options.size);
    }
    Run{options}();
}

} // namespace

void add_deblur(CLI::App& app) {
    auto options = std::make_shared<Options>();
    CLI::App* command =
        app.add_subcommand("deblur", "Turn a blurry frame and its events into sharp frames");
    Options& o = *options;
    command->add_option("-i,--input", o.input, "The blurry image, or a recording's folder")->required();
    command->add_option("-e,--events", o.events, "The events: HDF5 (DSEC's layout) or text");
    command->add_option("--exposure", o.exposure, "Start and end on the events' clock, microseconds")
        ->expected(2);
    command
        ->add_option("-o,--output", o.output,
                     "A folder, a video (.mp4, .mkv, .avi) or an array (.npy)")
        ->required();
    command->add_option("-m,--model", o.deblur.model, "A shipped model, a .safetensors file, or edi")
        ->capture_default_str();
    auto* frames = command->add_option("--frames", o.frames, "Frames, evenly over the exposure")
                       ->capture_default_str()
                       ->check(CLI::Range(1, 100000));
    auto* fps = command->add_option("--fps", o.fps, "Or: frames a second of exposure")
                    ->check(CLI::PositiveNumber)
                    ->excludes(frames);
    command->add_option("--times", o.times, "Or: normalised times, -1 start to 1 end, in any order")
        ->excludes(frames)
        ->excludes(fps);
    command
        ->add_option("--threshold", o.thresholds,
                     "Contrast thresholds C+ [C-] for edi (default: estimated)")
        ->expected(1, 2)
        ->check(CLI::Range(0.001, 10.0));
    command->add_option("--keypoints", o.deblur.keypoints, "Keypoints the model was trained for");
    command->add_option("--refine", o.deblur.refine, "Refinement iterations (0: initialisation alone)")
        ->check(CLI::Range(0, 1000));
    command->add_option("-g,--device", o.device, "Device: its index or part of its name (ecir devices)");
    command->add_option("--size", o.size, "Work at WIDTHxHEIGHT (area average; events are scaled)");
    command->add_flag("--overwrite", o.overwrite, "Replace an existing output");
    command->callback([options] { run(*options); });
}

} // namespace ecir::cli
