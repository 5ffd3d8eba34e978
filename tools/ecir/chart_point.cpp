#include "tools/ecir/chart_point.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

#include "tools/ecir/precision.hpp"

namespace ecir::cli {
namespace {

std::string text_of(const std::optional<uint32_t>& number) {
    return number ? std::to_string(*number) : "";
}

} // namespace

std::string ChartPoint::name() const {
    std::string text = model;
    if (quality) {
        text += std::string(", ") + quality_name(*quality);
    }
    if (refine) {
        text += ", refine " + std::to_string(*refine);
    }
    if (precision != Precision::float32) {
        text += std::string(", ") + precision_name(precision);
    }
    if (scale != 1) {
        char share[32];
        std::snprintf(share, sizeof share, ", size 1/%.3g", 1 / scale);
        text += share;
    }
    return text;
}

std::vector<bool> pareto_front(std::span<const ChartPoint> points, ChartValue cost,
                               ChartValue gain) {
    std::vector<bool> front;
    for (const ChartPoint& mine : points) {
        bool beaten = false;
        for (const ChartPoint& other : points) {
            const bool no_worse = other.*cost <= mine.*cost && other.*gain >= mine.*gain;
            beaten = beaten || (no_worse && (other.*cost < mine.*cost || other.*gain > mine.*gain));
        }
        front.push_back(!beaten);
    }
    return front;
}

void to_json(nlohmann::ordered_json& json, const ChartPoint& point) {
    json = {{"name", point.name()}, {"model", point.model},
            {"quality", nullptr},   {"keypoints", nullptr},
            {"refine", nullptr},    {"precision", precision_name(point.precision)},
            {"scale", point.scale}, {"psnr", point.psnr},
            {"ssim", point.ssim},   {"gflop", point.gflop},
            {"ms", point.ms},       {"ms_most", point.ms_most}};
    if (point.quality) {
        json["quality"] = quality_name(*point.quality);
    }
    if (point.keypoints) {
        json["keypoints"] = *point.keypoints;
    }
    if (point.refine) {
        json["refine"] = *point.refine;
    }
}

std::string to_csv(std::span<const ChartPoint> points) {
    std::string text =
        "model,quality,keypoints,refine,precision,scale,psnr_db,ssim,gflop,ms,ms_most,front\n";
    const auto front = pareto_front(points, &ChartPoint::ms, &ChartPoint::psnr);
    for (size_t i = 0; i < points.size(); ++i) {
        const ChartPoint& point = points[i];
        char line[256];
        std::snprintf(line, sizeof line, "%s,%s,%s,%s,%s,%g,%.3f,%.4f,%.4g,%.4g,%.4g,%d\n",
                      point.model.c_str(), point.quality ? quality_name(*point.quality) : "",
                      text_of(point.keypoints).c_str(), text_of(point.refine).c_str(),
                      precision_name(point.precision), point.scale, point.psnr, point.ssim,
                      point.gflop, point.ms, point.ms_most, front[i] ? 1 : 0);
        text += line;
    }
    return text;
}

} // namespace ecir::cli
