#include "tools/ecir/deblur_job.hpp"

#include <algorithm>
#include <cmath>
#include <exception>
#include <memory>
#include <set>
#include <span>
#include <thread>

#include "layers/prior.hpp"
#include "runtime/error.hpp"
#include "tools/ecir/console.hpp"
#include "tools/ecir/deblur_input.hpp"
#include "tools/ecir/deblur_report.hpp"
#include "tools/ecir/frame_output.hpp"
#include "tools/ecir/handover.hpp"
#include "tools/ecir/model_times.hpp"
#include "tools/ecir/precision.hpp"
#include "tools/ecir/stopwatch.hpp"

namespace ecir::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kVideoFps = 25; ///< of written videos: slow enough to see what moves
constexpr size_t kBegun = 2;     ///< exposures begun at a time

[[noreturn]] void refuse(const std::string& what) {
    throw Error(ExitCode::usage, what);
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

/// An exposure that the device works on, or worked on.
struct Deblurred {
    LoadedExposure exposure; ///< without its events
    std::vector<double> times;
    std::vector<float> frames;
    ExposureReport report;
};

/// Deblurs the exposures of a recording into one output. Three threads at a time work on exposures
/// that follow each other: one reads and decodes, one packs events and has the device compute (two
/// exposures are begun at a time, so that the device need not wait for the host), one encodes and
/// writes. Of errors the first in the order of the exposures ends the run.
class Run {
public:
    explicit Run(const DeblurJob& job)
        : job_(job), recording_(open_input(job)), console_("exposure", recording_.items.size()) {
        for (const auto& item : recording_.items) {
            frames_ += wanted_times(job, item.exposure).size();
        }
    }

    void operator()() {
        FrameOutput output(job_.output, job_.overwrite, frames_, kVideoFps);
        device_ = open_device(job_.device, job_.precision);
        if (!job_.lag || !job_.report.empty()) {
            lag_ = estimate_lag(recording_, *device_);
        }
        if (!recording_.note.empty()) {
            console_.note(recording_.note);
        }
        tell_lag();
        ExposureReader reader(job_, recording_, job_.lag.value_or(lag_.value_or(0)));
        if (!job_.report.empty()) {
            report_.emplace(job_.report, job_.overwrite, *device_,
                            job_.lag.value_or(lag_.value_or(0)), lag_);
        }
        if (device_->info().is_cpu && job_.device.empty()) {
            console_.note("no GPU found, using the CPU driver " + device_->info().name +
                          " (ecir devices lists all)");
        }
        device_->on_compiling([this] {
            console_.note("compiling kernels for " + device_->info().name +
                          ", which is done only once");
        });
        std::exception_ptr unwritten;
        std::exception_ptr uncomputed;
        std::jthread reading([&] { read_all(reader); });
        std::jthread writing;
        try {
            writing = std::jthread([&] { unwritten = write_all(output); });
            compute_all();
        } catch (...) {
            uncomputed = std::current_exception();
        }
        loaded_.abandon();
        deblurred_.close();
        reading.join();
        if (writing.joinable()) {
            writing.join();
        }
        // In the order of the exposures: what was to be written was computed before.
        for (const std::exception_ptr& error : {unwritten, uncomputed}) {
            if (error) {
                std::rethrow_exception(error);
            }
        }
        output.commit();
        if (unreported_) {
            std::rethrow_exception(unreported_);
        }
        if (report_) {
            report_->commit();
        }
    }

private:
    void read_all(ExposureReader& reader) {
        try {
            for (const auto& item : recording_.items) {
                if (!loaded_.put(reader.read(item))) {
                    return;
                }
            }
            reader.finish();
            loaded_.close();
        } catch (...) {
            loaded_.close(std::current_exception());
        }
    }

    std::exception_ptr write_all(FrameOutput& output) {
        try {
            while (auto deblurred = deblurred_.take()) {
                const Stopwatch watch;
                write(*deblurred, output);
                if (report_) {
                    deblurred->report.ms.write = watch.ms();
                    add_to_report(deblurred->report);
                }
            }
            return {};
        } catch (...) {
            deblurred_.abandon();
            return std::current_exception();
        }
    }

    /// Where that fails the frames go on; the error is told once they are in place.
    void add_to_report(const ExposureReport& exposure) {
        try {
            report_->add(exposure);
        } catch (...) {
            unreported_ = std::current_exception();
            report_.reset();
        }
    }

    void compute_all() {
        console_.progress(0);
        try {
            while (auto loaded = loaded_.take()) {
                begin(std::move(*loaded));
                if (begun_.size() == kBegun && !finish()) {
                    return;
                }
            }
        } catch (...) {
            // The exposures begun come before the one that failed, and so would their errors.
            while (!begun_.empty() && finish()) {
            }
            throw;
        }
        while (!begun_.empty() && finish()) {
        }
    }

    void begin(LoadedExposure loaded) {
        if (!deblur_) {
            const PixelSize size{loaded.image.width, loaded.image.height};
            deblur_.emplace(device_, options_for(size, loaded), static_cast<uint32_t>(size.width),
                            static_cast<uint32_t>(size.height));
        }
        Deblurred next;
        next.times = wanted_times(job_, loaded.item->exposure);
        begun_.reserve(kBegun);
        const Stopwatch watch;
        try {
            deblur_->begin(loaded.luminance, loaded.events.view(), loaded.exposure, next.times);
        } catch (const Error& error) {
            throw Error(error.code(), recording_.full_name(*loaded.item) + ": " + error.what());
        }
        next.report = report_of(loaded, next.times.size());
        next.report.ms = {.read = loaded.read_ms, .prepare = watch.ms()};
        loaded.events = {};
        next.exposure = std::move(loaded);
        begun_.push_back(std::move(next));
    }

    /// The job's options, within its budget.
    [[nodiscard]] DeblurOptions options_for(const PixelSize& size,
                                            const LoadedExposure& first) const {
        DeblurOptions options = job_.deblur;
        if (job_.budget_ms) {
            const auto frames =
                static_cast<uint32_t>(wanted_times(job_, first.item->exposure).size());
            const BudgetChoice choice = choose_within(*job_.budget_ms, device_, size, frames);
            options.largest = choice.model;
            char text[160];
            std::snprintf(text, sizeof text, "%s takes %.0f ms a blurry frame of which all moves",
                          choice.model.c_str(), choice.ms);
            if (choice.ms > *job_.budget_ms) {
                console_.warn(text + std::string(", over the budget, and is the smallest model; "
                                                 "fewer --frames or a smaller --size take less"));
            } else {
                console_.note(text);
            }
        }
        return options;
    }

    /// Hands the oldest exposure begun to the writer; false when that has failed.
    bool finish() {
        Deblurred oldest = std::move(begun_.front());
        begun_.erase(begun_.begin());
        try {
            const Stopwatch watch;
            oldest.frames = deblur_->finish();
            oldest.report.ms.wait = watch.ms();
        } catch (...) {
            begun_.clear(); // errors of those after it do not count
            throw;
        }
        oldest.report.model = deblur_->model();
        oldest.report.active_share = deblur_->active_share();
        oldest.report.windows = deblur_->windows();
        oldest.report.work = deblur_->work();
        if (oldest.report.facts.events > 0 && oldest.report.windows.empty()) {
            oldest.report.warnings.push_back(
                {"still", "its events look like noise, nothing in them like motion, so its frames "
                          "are the blurry frame"});
        }
        oldest.report.thresholds = deblur_->thresholds();
        oldest.report.ignored_pixels = deblur_->ignored_pixels();
        tell(oldest.report);
        console_.progress(++finished_);
        return deblurred_.put(std::move(oldest));
    }

    [[nodiscard]] ExposureReport report_of(const LoadedExposure& loaded, size_t frames) const {
        ExposureReport report;
        report.item = loaded.item;
        report.facts = loaded.facts;
        report.warnings = scene_warnings(loaded.facts, deblur_->travel_range());
        if (loaded.recorded) {
            report.warnings.push_back(*loaded.recorded);
        }
        if (lag_ && job_.lag) {
            if (auto late = lag_warning(loaded.facts, loaded.exposure,
                                        static_cast<double>(*lag_ - *job_.lag))) {
                report.warnings.push_back(std::move(*late));
            }
        }
        report.thresholds_given = job_.deblur.thresholds.has_value();
        report.frames = frames;
        return report;
    }

    void tell(const ExposureReport& report) {
        const std::string image = recording_.full_name(*report.item);
        for (const SceneWarning& warning : report.warnings) {
            // An exposure without events is told of each time: its frames are not sharp. What else
            // is wrong is mostly so for the whole recording.
            if (warning.name == "no-events") {
                console_.warn(image + ": " + recording_.events.string() +
                              " has no event in its exposure, so its frames are the blurry frame");
            } else if (told_warnings_.insert(warning.name).second) {
                console_.warn(image + ": " + warning.text);
            }
        }
        tell_thresholds(image, report.thresholds);
        if (report.ignored_pixels > 0) {
            console_.warn(image + ": " + std::to_string(report.ignored_pixels) +
                          " of its pixels have more than " + std::to_string(prior_busy_events) +
                          " events, which this model takes as without events; -m edi takes more");
        }
    }

    void tell_lag() const {
        if (!job_.lag) {
            console_.note(lag_ ? "estimated lag of the events: " + std::to_string(*lag_) + " us"
                               : "too little motion to tell how late the events are; taking them "
                                 "as on time");
        }
    }

    /// Once, and again where a recording's running estimate has moved.
    void tell_thresholds(const std::string& image, const std::optional<EdiThresholds>& used) {
        if (!used || job_.deblur.thresholds) {
            return;
        }
        char text[64];
        std::snprintf(text, sizeof text, "%.3f %.3f", static_cast<double>(used->positive),
                      static_cast<double>(used->negative));
        if (told_thresholds_ != text) {
            told_thresholds_ = text;
            console_.note(image + ": estimated thresholds " + text);
        }
    }

    void write(const Deblurred& deblurred, FrameOutput& output) const {
        const auto& item = deblurred.exposure.item;
        const io::Image& image = deblurred.exposure.image;
        const auto& luminance = deblurred.exposure.luminance;
        const bool single = recording_.items.size() == 1 && job_.exposure;
        io::Image sharp = image;
        for (size_t i = 0; i < deblurred.times.size(); ++i) {
            const auto frame =
                std::span(deblurred.frames).subspan(i * luminance.size(), luminance.size());
            if (image.channels == 1) {
                sharp.pixels.assign(frame.begin(), frame.end());
            } else {
                sharp.pixels = recolour(image.pixels, luminance, frame, 3);
            }
            const double time = deblurred.times[i];
            output.add(
                sharp,
                {{}, time, io::absolute_time(item->exposure, time), single ? "" : item->name});
        }
    }

    const DeblurJob& job_;
    io::Recording recording_;
    Console console_;
    std::optional<DeblurReport> report_;
    std::exception_ptr unreported_;
    std::optional<int64_t> lag_; ///< of the events as estimated, microseconds
    size_t frames_ = 0;
    Handover<LoadedExposure> loaded_{2};
    Handover<Deblurred> deblurred_{1};
    // From here on only the thread that computes.
    std::shared_ptr<Device> device_;
    std::optional<Deblur> deblur_;
    std::vector<Deblurred> begun_; ///< the oldest first
    std::string told_thresholds_;
    std::set<std::string> told_warnings_;
    size_t finished_ = 0;
};

} // namespace

void run_deblur(const DeblurJob& job) {
    Run{job}();
}

} // namespace ecir::cli
