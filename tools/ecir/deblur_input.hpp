#pragma once
#include <vector>

#include "layers/scene_facts.hpp"
#include "tools/ecir/deblur_job.hpp"
#include "tools/io/event_windows.hpp"
#include "tools/io/image.hpp"
#include "tools/io/recording.hpp"

namespace ecir::cli {

/// An exposure as it goes to the device, at the size to work at.
struct LoadedExposure {
    const io::Recording::Item* item = nullptr;
    Exposure exposure; ///< on the events' clock
    io::Image image;
    std::vector<float> luminance;
    Events events; ///< of the exposure
    SceneFacts facts;
    std::optional<SceneWarning> recorded; ///< where the events end or begin within it
    double read_ms = 0;
};

/// What a job asks to deblur: a recording, or one image as a recording of one.
/// Throws Error: usage for options that do not fit the input and for outputs that would replace
/// what is read, or each other; bad_input as open_recording() does.
io::Recording open_input(const DeblurJob& job);

/// How late a recording's events are, microseconds, from its first exposures: roughly from one to
/// the next where there are enough (EventLagEstimator), then from each by itself
/// (FrameLagEstimator). None where too little moves. Errors as for ExposureReader::read().
std::optional<int64_t> estimate_lag(const io::Recording& recording, Device& device);

/// Reads a recording's exposures, images and events, one after another.
class ExposureReader {
public:
    /// Throws Error(bad_input) for an exposure that lies wholly outside the events, a mistake in
    /// the clock (which a camera's own file cannot have), and as EventWindows does. `job` and
    /// `recording` must live on.
    /// lag: of the events, microseconds.
    ExposureReader(const DeblurJob& job, const io::Recording& recording, int64_t lag);

    /// Throws Error(bad_input), naming the file, for what cannot be read, and for an image or
    /// events that are not of the sensor of the exposures before.
    LoadedExposure read(const io::Recording::Item& item);

    /// After the last exposure: checks the rest of a recording's events, too.
    void finish() { events_.finish(); }

private:
    void check_image(const io::Image& image, const std::string& name);

    const DeblurJob& job_;
    const io::Recording& recording_;
    int64_t lag_;
    io::EventWindows events_;
    PixelSize sensor_{}; ///< of the first image
    int channels_ = 0;   ///< 0: there was no image yet
};

} // namespace ecir::cli
