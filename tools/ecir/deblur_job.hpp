#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "layers/deblur.hpp"
#include "tools/ecir/resize.hpp"

namespace ecir::cli {

/// What `ecir deblur` was asked for, checked as far as the options alone tell.
struct DeblurJob {
    std::filesystem::path input;      ///< a blurry image, or a recording
    std::filesystem::path events;     ///< of an image
    std::optional<Exposure> exposure; ///< of an image
    /// Of a recording: only these exposures, counted from 0, both ends included.
    std::optional<std::pair<size_t, size_t>> only;
    std::filesystem::path output;
    std::filesystem::path report; ///< JSON; empty: none
    DeblurOptions deblur;
    std::optional<double> budget_ms; ///< for a blurry frame
    std::vector<double> times;       ///< normalised; empty: by `fps`
    double fps = 0;
    std::optional<PixelSize> size;
    std::optional<int64_t> lag = 0; ///< of the events behind the frames, us; none: estimate
    std::string device;
    Precision precision = Precision::float32;
    bool overwrite = false;
};

/// Deblurs one image or a whole recording into one output. Throws Error.
void run_deblur(const DeblurJob& job);

} // namespace ecir::cli
