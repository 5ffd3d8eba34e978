#pragma once
#include <filesystem>
#include <memory>
#include <vector>

#include "layers/events.hpp"
#include "runtime/device.hpp"
#include "tools/ecir/chart_point.hpp"
#include "tools/ecir/console.hpp"
#include "tools/ecir/metrics.hpp"
#include "tools/io/image.hpp"

namespace ecir::cli {

/// One exposure whose sharp frames are known.
struct ChartScene {
    io::Image blurry; ///< grey
    Events events;
    Exposure exposure;
    std::vector<metrics::Frame> truth; ///< at even times from -1 to 1
};

/// The recordings of one exposure with a folder `truth` in a folder, as `ecir simulate` and
/// tools/train/simulate.py write them, or the folder itself if it is one. Colour is taken as
/// luminance. Throws Error(bad_input) where there is none, or they differ in size or frames.
std::vector<ChartScene> read_chart_scenes(const std::filesystem::path& folder);

/// What there is to compare: every model, networks also without their refinement and E-CIR with 1
/// to `most_refine` iterations, `auto` at each quality; networks in every precision; all also at
/// half size.
std::vector<ChartPoint> chart_configurations(const std::vector<std::string>& models,
                                             uint32_t most_refine,
                                             const std::vector<Precision>& precisions);

/// Fills in accuracy, time and operations over the scenes, each as a recording of its own whose
/// thresholds, estimated once, are known when the time is taken: from image and events in host
/// memory to frames in host memory, at the size that the point works at. The device is one of the
/// point's precision.
void measure(ChartPoint& point, const std::shared_ptr<Device>& device,
             const std::vector<ChartScene>& scenes);

} // namespace ecir::cli
