#pragma once
#include <span>
#include <string>

#include "tools/ecir/chart_point.hpp"

namespace ecir::cli {

/// PSNR and SSIM (rows) against time and operations for a blurry frame (columns, logarithmic) as an
/// SVG: a colour a model, hollow marks below full size, the Pareto front of each panel as a line
/// whose points are named. At least one point; costs positive.
std::string chart_svg(std::span<const ChartPoint> points, const std::string& title,
                      const std::string& subtitle);

} // namespace ecir::cli
