#pragma once
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "layers/model_family.hpp"
#include "runtime/device.hpp"

namespace ecir::cli {

/// A way to run `ecir deblur`, with what it gives and costs: a point of the chart.
struct ChartPoint {
    std::string model;
    std::optional<uint32_t> keypoints; ///< n of a curve, which its network was trained for
    std::optional<uint32_t> refine;    ///< unset: as trained
    /// Of the model `auto`, which computes only what moves; all others compute the whole image.
    std::optional<Quality> quality;
    Precision precision = Precision::float32;
    double scale = 1; ///< of width and height (--size); results enlarged again
    double psnr = 0;  ///< dB, mean over the evaluation scenes' frames
    double ssim = 0;
    double gflop = 0;   ///< a blurry frame, mean over the scenes
    double ms = 0;      ///< a blurry frame in steady state, mean over the scenes
    double ms_most = 0; ///< of the slowest scene

    /// "ecir, refine 2, size 1/2", "auto, balanced", "fusion, float16".
    [[nodiscard]] std::string name() const;
};

using ChartValue = double ChartPoint::*;

/// Whether each point is on the Pareto front: no other one costs no more and gives no less, and one
/// of both strictly.
std::vector<bool> pareto_front(std::span<const ChartPoint> points, ChartValue cost,
                               ChartValue gain);

void to_json(nlohmann::ordered_json& json, const ChartPoint& point);

/// One line a point after a line of column names.
std::string to_csv(std::span<const ChartPoint> points);

} // namespace ecir::cli
