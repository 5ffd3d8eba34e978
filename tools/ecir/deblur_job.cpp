#include "tools/ecir/deblur_job.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>

#include "layers/prior.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/console.hpp"
#include "tools/ecir/frame_output.hpp"
#include "tools/io/event_file.hpp"
#include "tools/io/file.hpp"
#include "tools/io/recording.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kVideoFps = 25; ///< of written videos: slow enough to see what moves

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::usage, what);
}

std::string size_text(int width, int height) {
    return std::to_string(width) + " x " + std::to_string(height);
}

/// Times `1 / fps` of a second apart, from the start of the exposure on.
std::vector<double> times_at(double fps, const Exposure& exposure) {
    const double seconds = static_cast<double>(exposure.duration()) * 1e-6;
    constexpr double kSlack = 1e-9; // the last frame of 0.1 s at 100 fps belongs to it
    constexpr double kMost = 1e6;
    const double last = std::floor(seconds * fps + kSlack);
    if (last >= kMost) {
        refuse("--fps asks for more than a million frames of one exposure of " +
               std::to_string(seconds) +
               " s; give frames a second, and --exposure in microseconds");
    }
    std::vector<double> times(static_cast<size_t>(last) + 1);
    for (size_t i = 0; i < times.size(); ++i) {
        times[i] = std::min(1.0, -1 + 2 * static_cast<double>(i) / fps / seconds);
    }
    return times;
}

std::vector<double> wanted_times(const DeblurJob& job, const Exposure& exposure) {
    return job.times.empty() ? times_at(job.fps, exposure) : job.times;
}

io::Recording one_frame(const DeblurJob& job) {
    if (job.events.empty() || !job.exposure) {
        refuse("a single frame needs its events (-e FILE) and its exposure (--exposure START END); "
               "a recording is a folder with exposures.csv");
    }
    if (job.exposure->end <= job.exposure->start) {
        throw Error(ExitCode::bad_input, "the exposure of " + job.input.string() + " ends at " +
                                             std::to_string(job.exposure->end) +
                                             " us, not after its start at " +
                                             std::to_string(job.exposure->start) +
                                             " us; give --exposure START END in microseconds");
    }
    return {{{job.input, *job.exposure}}, job.events};
}

bool is_recording(const DeblurJob& job) {
    std::error_code problem;
    const fs::file_status status = fs::status(job.input, problem);
    if (!fs::exists(status)) {
        throw Error(ExitCode::bad_input, job.input.string() +
                                             ": cannot open: " + problem.message() +
                                             "; give the blurry image, or a recording's folder");
    }
    return fs::is_directory(status);
}

io::Recording open_input(const DeblurJob& job) {
    if (!is_recording(job)) {
        return one_frame(job);
    }
    if (!job.events.empty() || job.exposure) {
        refuse("-e and --exposure go with a single frame; a recording's folder holds both");
    }
    return io::open_recording(job.input);
}

/// A window wholly outside what the file recorded is a mistake in the clock, not a still scene.
void check_exposure(const Exposure& exposure, const EventView& events, const fs::path& file) {
    if (events.size() == 0 ||
        (exposure.start <= events.t.back() && events.t.front() <= exposure.end)) {
        return;
    }
    throw Error(ExitCode::bad_input,
                file.string() + ": the exposure " + std::to_string(exposure.start) + " to " +
                    std::to_string(exposure.end) +
                    " lies wholly outside the events, which run from " +
                    std::to_string(events.t.front()) + " to " + std::to_string(events.t.back()) +
                    " us; give both on one clock, in microseconds");
}

void check_sensor(const io::EventFile& events, const io::Image& image, const fs::path& image_path,
                  const fs::path& events_path) {
    if (events.width && events.height &&
        (*events.width != image.width || *events.height != image.height)) {
        throw Error(ExitCode::bad_input, events_path.string() + ": the events are of a sensor of " +
                                             size_text(*events.width, *events.height) +
                                             " pixels, " + image_path.string() + " has " +
                                             size_text(image.width, image.height) +
                                             "; give the image and the events of one sensor");
    }
    io::check_inside(events.events.view(), image.width, image.height, events_path);
}

/// Deblurs the exposures of a recording one after another into one output.
class Run {
public:
    explicit Run(const DeblurJob& job)
        : job_(job), recording_(open_input(job)), console_("exposure", recording_.items.size()) {
        for (const fs::path& read : {job.input, recording_.events, fs::path(job.deblur.model)}) {
            if (io::lies_within(read, job.output)) {
                refuse(job.output.string() + " is or holds the input " + read.string() +
                       "; choose another output");
            }
        }
        for (const auto& item : recording_.items) {
            frames_ += wanted_times(job, item.exposure).size();
        }
    }

    void operator()() {
        FrameOutput output(job_.output, job_.overwrite, frames_, kVideoFps);
        const io::EventFile file = io::read_events(recording_.events);
        for (const auto& item : recording_.items) {
            check_exposure(item.exposure, file.events.view(), recording_.events);
        }
        device_ = Device::open(job_.device);
        if (device_->info().is_cpu && job_.device.empty()) {
            console_.note("no GPU found, using the CPU driver " + device_->info().name +
                          " (ecir devices lists all)");
        }
        device_->on_compiling([this] {
            console_.note("compiling kernels for " + device_->info().name +
                          ", which is done only once");
        });
        for (size_t i = 0; i < recording_.items.size(); ++i) {
            console_.progress(i);
            exposure(recording_.items[i], file, output);
        }
        output.commit();
    }

private:
    void exposure(const io::Recording::Item& item, const io::EventFile& file, FrameOutput& output) {
        io::Image image = io::read_image(item.image);
        check_image(image, item.image, file);
        Events scaled;
        EventView events = window(file.events.view(), item.exposure);
        if (events.size() == 0) {
            console_.warn(item.image.string() + ": " + recording_.events.string() +
                          " has no event in its exposure, so its frames are the blurry frame");
        }
        if (job_.size) {
            scaled = scale_events(events, image.width, image.height, *job_.size);
            events = scaled.view();
            image = resize_area(image, *job_.size);
        }
        if (!deblur_) {
            deblur_.emplace(device_, job_.deblur, static_cast<uint32_t>(image.width),
                            static_cast<uint32_t>(image.height));
        }
        const std::vector<double> times = wanted_times(job_, item.exposure);
        const std::vector<float> luminance = io::luminance(image);
        const auto frames = deblur_->frames(luminance, events, item.exposure, times);
        tell_thresholds(item.image, events);
        if (deblur_->ignored_pixels() > 0) {
            console_.warn(item.image.string() + ": " + std::to_string(deblur_->ignored_pixels()) +
                          " of its pixels have more than " + std::to_string(prior_busy_events) +
                          " events, which this model takes as without events; -m edi takes more");
        }
        write(image, luminance, frames, times, item, output);
    }

    /// One Deblur object serves all exposures, so all images have the first one's size.
    void check_image(const io::Image& image, const fs::path& path, const io::EventFile& file) {
        if (!deblur_) {
            check_sensor(file, image, path, recording_.events);
            sensor_ = {image.width, image.height};
            channels_ = image.channels;
        }
        if (image.width != sensor_.width || image.height != sensor_.height) {
            throw Error(ExitCode::bad_input, path.string() + ": has " +
                                                 size_text(image.width, image.height) +
                                                 " pixels, the images before it " +
                                                 size_text(sensor_.width, sensor_.height) +
                                                 "; a recording has the images of one sensor");
        }
        if (image.channels != channels_) {
            throw Error(ExitCode::bad_input,
                        path.string() + ": is " + (image.channels == 1 ? "grey" : "colour") +
                            ", unlike the images before it; a recording is all grey or all colour");
        }
    }

    void tell_thresholds(const fs::path& image, const EventView& events) const {
        const auto used = deblur_->thresholds();
        if (!used || job_.deblur.thresholds || events.size() == 0) {
            return;
        }
        char text[64];
        std::snprintf(text, sizeof text, "%.3f %.3f", static_cast<double>(used->positive),
                      static_cast<double>(used->negative));
        console_.note(image.string() + ": estimated thresholds " + text);
    }

    void write(const io::Image& image, const std::vector<float>& luminance,
               std::span<const float> frames, const std::vector<double>& times,
               const io::Recording::Item& item, FrameOutput& output) const {
        const bool single = recording_.items.size() == 1 && job_.exposure;
        io::Image sharp = image;
        for (size_t i = 0; i < times.size(); ++i) {
            const auto frame = frames.subspan(i * luminance.size(), luminance.size());
            if (image.channels == 1) {
                sharp.pixels.assign(frame.begin(), frame.end());
            } else {
                sharp.pixels = recolour(image.pixels, luminance, frame, 3);
            }
            output.add(sharp, {{},
                               times[i],
                               io::absolute_time(item.exposure, times[i]),
                               single ? "" : item.image.lexically_relative(job_.input).string()});
        }
    }

    const DeblurJob& job_;
    io::Recording recording_;
    Console console_;
    size_t frames_ = 0;
    std::shared_ptr<Device> device_;
    std::optional<Deblur> deblur_;
    PixelSize sensor_{};
    int channels_ = 1;
};

} // namespace

void run_deblur(const DeblurJob& job) {
    Run{job}();
}

} // namespace ecir::cli
