#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "layers/edi.hpp"
#include "layers/method.hpp"
#include "layers/regions.hpp"
#include "layers/scene_facts.hpp"
#include "runtime/device.hpp"
#include "tools/io/file.hpp"
#include "tools/io/output.hpp"
#include "tools/io/recording.hpp"

namespace ecir::cli {

/// Wall time that an exposure took in each stage, milliseconds. Stages of exposures that follow
/// each other overlap.
struct StageTimes {
    double read = 0;    ///< reading and decoding the image and the events, looking at them
    double prepare = 0; ///< packing events, estimating thresholds, starting the device
    double wait = 0;    ///< for the device
    double write = 0;   ///< encoding and writing
};

/// What the report says of an exposure.
struct ExposureReport {
    const io::Recording::Item* item = nullptr;
    SceneFacts facts;
    std::vector<SceneWarning> warnings;
    std::optional<EdiThresholds> thresholds; ///< used
    bool thresholds_given = false;
    size_t ignored_pixels = 0;
    std::string model; ///< empty: nothing moved, the frames are the blurry one
    double active_share = 0;
    std::vector<PixelRect> windows; ///< computed; none: nothing moved
    std::vector<MethodWork> work;   ///< by window
    size_t frames = 0;
    StageTimes ms;
};

/// The file of `ecir deblur --report`: JSON with what was found in each exposure and what was used.
/// Exposures go to the disk as they come, so memory does not grow with their number.
class DeblurReport {
public:
    /// Lags of the events, microseconds: what was used, what was estimated. Throws Error as
    /// PendingOutput does.
    DeblurReport(const std::filesystem::path& file, bool overwrite, const Device& device,
                 int64_t lag, std::optional<int64_t> estimated_lag);
    void add(const ExposureReport& exposure);
    /// Makes the file appear under its name.
    void commit();

private:
    void write(const std::string& text);

    io::PendingOutput output_;
    io::FileWriter writer_;
    bool first_ = true;
};

} // namespace ecir::cli
