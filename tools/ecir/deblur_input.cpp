#include "tools/ecir/deblur_input.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "layers/event_lag.hpp"
#include "layers/frame_lag.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/stopwatch.hpp"
#include "tools/io/file.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::usage, what);
}

std::string size_text(int width, int height) {
    return std::to_string(width) + " x " + std::to_string(height);
}

io::Recording one_frame(const DeblurJob& job) {
    if (fs::is_regular_file(job.input) && io::holds_events(job.input)) {
        throw Error(ExitCode::bad_input, job.input.string() +
                                             ": holds events and no frames; give the image with "
                                             "-i, and this file with -e");
    }
    if (job.events.empty() || !job.exposure) {
        refuse("a single frame needs its events (-e FILE) and its exposure (--exposure START END); "
               "a recording is a folder with exposures.csv, or an AEDAT 4 file");
    }
    if (job.exposure->end <= job.exposure->start) {
        throw Error(ExitCode::bad_input, "the exposure of " + job.input.string() + " ends at " +
                                             std::to_string(job.exposure->end) +
                                             " us, not after its start at " +
                                             std::to_string(job.exposure->start) +
                                             " us; give --exposure START END in microseconds");
    }
    io::Recording recording;
    recording.items.push_back({job.input.string(), *job.exposure, 0});
    recording.events = job.events;
    return recording;
}

bool is_recording(const DeblurJob& job) {
    std::error_code problem;
    const fs::file_status status = fs::status(job.input, problem);
    if (!fs::exists(status)) {
        throw Error(ExitCode::bad_input, job.input.string() +
                                             ": cannot open: " + problem.message() +
                                             "; give the blurry image, or a recording");
    }
    return fs::is_directory(status) ||
           (fs::is_regular_file(status) && io::is_camera_file(job.input));
}

/// Refuses outputs that would replace what is read, or each other.
void check_outputs(const DeblurJob& job, const io::Recording& recording) {
    std::error_code ignored;
    std::vector<fs::path> files{recording.events};
    for (const auto& item : recording.items) {
        if (!recording.frames) { // those lie in the events' file
            files.push_back(recording.place / item.name);
        }
    }
    if (fs::is_regular_file(job.deblur.model, ignored)) {
        files.emplace_back(job.deblur.model);
    }
    if (fs::is_directory(job.input, ignored)) {
        files.push_back(job.input / "exposures.csv");
        if (io::lies_within(job.input, job.output)) {
            refuse(job.output.string() + " is or holds the input " + job.input.string() +
                   "; choose another output");
        }
    }
    for (const fs::path& read : files) {
        for (const fs::path& written : {job.output, job.report}) {
            if (io::lies_within(read, written)) {
                refuse(written.string() + " is or holds the input " + read.string() +
                       "; choose another output");
            }
        }
    }
    if (io::lies_within(job.report, job.output) || io::lies_within(job.output, job.report)) {
        refuse("--report " + job.report.string() + ": is, holds or lies in the output " +
               job.output.string() + ", which is put in place as a whole; choose a file beside it");
    }
}

/// Leaves the exposures that are asked for.
void choose(io::Recording& recording, const DeblurJob& job) {
    const auto [first, last] = *job.only;
    const size_t count = recording.items.size();
    if (last >= count) {
        refuse("--only " + std::to_string(first) + " " + std::to_string(last) + ": " +
               job.input.string() + " has " + std::to_string(count) + " exposures, 0 to " +
               std::to_string(count - 1));
    }
    const auto begin = recording.items.begin();
    recording.items = {begin + static_cast<std::ptrdiff_t>(first),
                       begin + static_cast<std::ptrdiff_t>(last) + 1};
}

Exposure later(const Exposure& exposure, int64_t lag) {
    return {exposure.start + lag, exposure.end + lag};
}

/// A window wholly outside what the file recorded is a mistake in the clock, not a still scene.
void check_exposure(const Exposure& exposure, int64_t lag, const io::EventWindows& events) {
    const auto& span = events.span();
    const Exposure moved = later(exposure, lag);
    if (!span || (moved.start <= span->last && span->first <= moved.end)) {
        return;
    }
    throw Error(ExitCode::bad_input,
                events.path().string() + ": the exposure " + std::to_string(exposure.start) +
                    " to " + std::to_string(exposure.end) +
                    (lag != 0 ? ", events late by " + std::to_string(lag) + " us," : "") +
                    " lies wholly outside the events, which run from " +
                    std::to_string(span->first) + " to " + std::to_string(span->last) +
                    " us; give both on one clock, in microseconds");
}

/// Where the file's events begin or end within the exposure. What does not move makes no events
/// either; so only where most of it has none. (An exposure wholly outside has no events at all, and
/// is told of as such.)
std::optional<SceneWarning> recorded_warning(const Exposure& exposure,
                                             const io::EventWindows& events) {
    constexpr double kLeast = 0.5;
    const auto& span = events.span();
    if (!span) {
        return std::nullopt;
    }
    const int64_t first = std::max(span->first, exposure.start);
    const int64_t last = std::min(span->last, exposure.end);
    const double share =
        static_cast<double>(last - first) / static_cast<double>(exposure.duration());
    if (share >= kLeast || last < first) {
        return std::nullopt;
    }
    return SceneWarning{"partly-recorded",
                        events.path().string() + " has events from " + std::to_string(span->first) +
                            " to " + std::to_string(span->last) +
                            " us only, less than half of the exposure " +
                            std::to_string(exposure.start) + " to " + std::to_string(exposure.end) +
                            " us: a still scene, another clock or unit, or a recording cut off"};
}

void check_size(const PixelSize& size, const io::Image& image, const std::string& name) {
    if (size.width > image.width || size.height > image.height) {
        refuse("--size " + size_text(size.width, size.height) + " is larger than " + name + ", " +
               size_text(image.width, image.height) +
               "; events cannot be made finer: give a smaller size, or leave --size out");
    }
}

void check_sensor(const io::EventWindows& events, const io::Image& image, const std::string& name) {
    if (events.width() && events.height() &&
        (*events.width() != image.width || *events.height() != image.height)) {
        throw Error(ExitCode::bad_input,
                    events.path().string() + ": the events are of a sensor of " +
                        size_text(*events.width(), *events.height()) + " pixels, " + name +
                        " has " + size_text(image.width, image.height) +
                        "; give the image and the events of one sensor");
    }
}

Events copy_of(const EventView& events) {
    return {{events.t.begin(), events.t.end()},
            {events.x.begin(), events.x.end()},
            {events.y.begin(), events.y.end()},
            {events.p.begin(), events.p.end()}};
}

std::optional<int64_t> lag_between_frames(const io::Recording& recording,
                                          io::EventWindows& windows) {
    constexpr size_t kPairs = 8;
    std::optional<EventLagEstimator> estimator;
    std::vector<float> before;
    for (size_t i = 0; i < std::min(recording.items.size(), kPairs + 1); ++i) {
        const auto& item = recording.items[i];
        const io::Image image = recording.read(item);
        std::vector<float> luminance = io::luminance(image);
        const bool follows = i > 0 && recording.items[i - 1].exposure.end <= item.exposure.start &&
                             before.size() == luminance.size();
        if (follows) {
            const Exposure& first = recording.items[i - 1].exposure;
            const auto [events, number] =
                windows.read({first.start - EventLagEstimator::kReach,
                              item.exposure.end + EventLagEstimator::kReach});
            io::check_inside(events, image.width, image.height, windows.path(), number);
            if (!estimator) {
                estimator.emplace(static_cast<uint32_t>(image.width),
                                  static_cast<uint32_t>(image.height));
            }
            estimator->add(before, first, luminance, item.exposure, events);
        }
        before = std::move(luminance);
    }
    return estimator ? estimator->estimate() : std::nullopt;
}

/// From single frames: the middle one of what the first three that tell say.
std::optional<int64_t> lag_of_frames(const io::Recording& recording, io::EventWindows& windows,
                                     int64_t guess, Device& device) {
    constexpr size_t kFrames = 8;
    constexpr size_t kEnough = 3;
    std::vector<double> found;
    for (size_t i = 0; i < std::min(recording.items.size(), kFrames) && found.size() < kEnough;
         ++i) {
        const auto& item = recording.items[i];
        const io::Image image = recording.read(item);
        const auto reach =
            std::llround(FrameLagEstimator::kReach * static_cast<double>(item.exposure.duration()));
        const auto [events, number] =
            windows.read({item.exposure.start + guess - reach, item.exposure.end + guess + reach});
        io::check_inside(events, image.width, image.height, windows.path(), number);
        if (std::min(image.width, image.height) < static_cast<int>(edi_smallest_side)) {
            continue;
        }
        FrameLagEstimator estimator(device, static_cast<uint32_t>(image.width),
                                    static_cast<uint32_t>(image.height));
        if (const auto lag = estimator.estimate(io::luminance(image), events, item.exposure,
                                                static_cast<double>(guess))) {
            found.push_back(*lag);
        }
    }
    if (found.empty()) {
        return std::nullopt;
    }
    std::ranges::sort(found);
    return std::llround(found[found.size() / 2]);
}

} // namespace

io::Recording open_input(const DeblurJob& job) {
    io::Recording recording;
    if (!is_recording(job)) {
        if (job.only) {
            refuse("--only chooses exposures of a recording; " + job.input.string() +
                   " is a single image");
        }
        recording = one_frame(job);
    } else if (!job.events.empty() || job.exposure) {
        refuse("-e and --exposure go with a single frame; a recording holds both");
    } else {
        recording = io::open_recording(job.input);
    }
    check_outputs(job, recording);
    if (job.only) {
        choose(recording, job);
    }
    return recording;
}

std::optional<int64_t> estimate_lag(const io::Recording& recording, Device& device) {
    io::EventWindows windows(recording.events, io::EventWindows::Reading::sparse);
    const auto coarse = lag_between_frames(recording, windows);
    const auto fine = lag_of_frames(recording, windows, coarse.value_or(0), device);
    return fine ? fine : coarse;
}

ExposureReader::ExposureReader(const DeblurJob& job, const io::Recording& recording, int64_t lag)
    : job_(job), recording_(recording), lag_(lag),
      events_(recording.events,
              job.exposure ? io::EventWindows::Reading::sparse : io::EventWindows::Reading::whole) {
    for (const auto& item : recording.items) {
        if (!recording.frames) { // a camera's own times can lie outside, at the ends
            check_exposure(item.exposure, lag, events_);
        }
    }
}

LoadedExposure ExposureReader::read(const io::Recording::Item& item) {
    const Stopwatch watch;
    LoadedExposure loaded;
    loaded.item = &item;
    loaded.image = recording_.read(item);
    io::Image& image = loaded.image;
    const std::string name = recording_.full_name(item);
    check_image(image, name);
    loaded.exposure = later(item.exposure, lag_);
    loaded.recorded = recorded_warning(loaded.exposure, events_);
    const auto [events, first] = events_.read(loaded.exposure);
    io::check_inside(events, image.width, image.height, events_.path(), first);
    if (job_.size) {
        check_size(*job_.size, image, name);
        loaded.events = scale_events(events, image.width, image.height, *job_.size);
        image = resize_area(image, *job_.size);
    } else {
        loaded.events = copy_of(events);
    }
    loaded.luminance = io::luminance(image);
    loaded.facts =
        scene_facts(loaded.luminance, loaded.events.view(), loaded.exposure,
                    static_cast<uint32_t>(image.width), static_cast<uint32_t>(image.height));
    loaded.read_ms = watch.ms();
    return loaded;
}

/// One Deblur object serves all exposures, so all images have the first one's size.
void ExposureReader::check_image(const io::Image& image, const std::string& name) {
    if (channels_ == 0) {
        check_sensor(events_, image, name);
        sensor_ = {image.width, image.height};
        channels_ = image.channels;
    }
    if (image.width != sensor_.width || image.height != sensor_.height) {
        throw Error(ExitCode::bad_input, name + ": has " + size_text(image.width, image.height) +
                                             " pixels, the images before it " +
                                             size_text(sensor_.width, sensor_.height) +
                                             "; a recording has the images of one sensor");
    }
    if (image.channels != channels_) {
        throw Error(ExitCode::bad_input,
                    name + ": is " + (image.channels == 1 ? "grey" : "colour") +
                        ", unlike the images before it; a recording is all grey or all colour");
    }
}

} // namespace ecir::cli
