#include "tools/ecir/deblur_report.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>

#include "tools/ecir/precision.hpp"

namespace ecir::cli {
namespace {

using Json = nlohmann::ordered_json;

/// Three significant places beyond the unit: figures for people, not doubles for the bit.
double rounded(double value) {
    return std::round(value * 1e4) / 1e4;
}

Json describe(const SceneFacts& facts) {
    Json scene;
    scene["events"] = facts.events;
    scene["events_per_pixel"] = rounded(facts.events_per_pixel);
    scene["active_share"] = rounded(facts.active_share);
    scene["positive_share"] = rounded(facts.positive_share);
    scene["travel_px"] = rounded(facts.travel);
    scene["white_share"] = rounded(facts.white_share);
    scene["black_share"] = rounded(facts.black_share);
    scene["isolated_share"] = rounded(facts.isolated_share);
    scene["agreeing_share"] = rounded(facts.agreeing_share);
    scene["hot_pixels"] = facts.hot_pixels;
    scene["flicker_hz"] = facts.flicker_hz > 0 ? Json(facts.flicker_hz) : Json();
    scene["flicker_share"] = rounded(facts.flicker_share);
    scene["bunched_share"] = rounded(facts.bunched_share);
    scene["longest_gap_us"] = facts.longest_gap;
    return scene;
}

/// By window: iterations, and the largest change of a pixel in each, grey levels; null without any.
Json describe_refinement(const std::vector<MethodWork>& windows) {
    Json iterations = Json::array();
    Json updates = Json::array();
    for (const MethodWork& work : windows) {
        if (!work.updates.empty()) {
            iterations.push_back(work.updates.size());
            updates.push_back(Json::array());
            for (const float update : work.updates) {
                updates.back().push_back(rounded(255 * double{update}));
            }
        }
    }
    return iterations.empty()
               ? Json()
               : Json{{"iterations", iterations}, {"largest_update_levels", updates}};
}

/// Pixels computed, by the order of their curve, and its mean; null where no order follows events.
Json describe_orders(const std::vector<MethodWork>& windows) {
    std::vector<size_t> pixels;
    for (const MethodWork& work : windows) {
        pixels.resize(std::max(pixels.size(), work.orders.size()));
        std::ranges::transform(work.orders, pixels, pixels.begin(), std::plus<>());
    }
    double all = 0;
    double sum = 0;
    for (size_t order = 0; order < pixels.size(); ++order) {
        all += static_cast<double>(pixels[order]);
        sum += static_cast<double>(order * pixels[order]);
    }
    return all > 0 ? Json{{"mean", rounded(sum / all)}, {"pixels", pixels}} : Json();
}

Json describe(const ExposureReport& exposure) {
    Json entry;
    entry["file"] = std::filesystem::path(exposure.item->name).filename().string();
    entry["start_us"] = exposure.item->exposure.start;
    entry["end_us"] = exposure.item->exposure.end;
    entry["scene"] = describe(exposure.facts);
    entry["warnings"] = Json::array();
    for (const SceneWarning& warning : exposure.warnings) {
        entry["warnings"].push_back({{"name", warning.name}, {"text", warning.text}});
    }
    entry["model"] = exposure.model.empty() ? Json() : Json(exposure.model);
    entry["moving_share"] = rounded(exposure.active_share);
    entry["windows"] = Json::array();
    for (const PixelRect& window : exposure.windows) {
        entry["windows"].push_back({{"left", window.left},
                                    {"top", window.top},
                                    {"width", window.width()},
                                    {"height", window.height()}});
    }
    entry["refinement"] = describe_refinement(exposure.work);
    entry["orders"] = describe_orders(exposure.work);
    entry["frames"] = exposure.frames;
    if (exposure.thresholds) {
        entry["thresholds"] = {{"positive", rounded(double{exposure.thresholds->positive})},
                               {"negative", rounded(double{exposure.thresholds->negative})},
                               {"estimated", !exposure.thresholds_given}};
    }
    entry["ignored_pixels"] = exposure.ignored_pixels;
    entry["ms"] = {{"read", rounded(exposure.ms.read)},
                   {"prepare", rounded(exposure.ms.prepare)},
                   {"wait", rounded(exposure.ms.wait)},
                   {"write", rounded(exposure.ms.write)}};
    return entry;
}

} // namespace

DeblurReport::DeblurReport(const std::filesystem::path& file, bool overwrite, const Device& device,
                           int64_t lag, std::optional<int64_t> estimated_lag)
    : output_(file, false, overwrite), writer_(output_.path()) {
    write("{\n\"device\": " + Json(device.info().name).dump() + ",\n\"precision\": " +
          Json(precision_name(device.precision())).dump() + ",\n\"lag_us\": " + Json(lag).dump() +
          ",\n\"estimated_lag_us\": " + (estimated_lag ? Json(*estimated_lag) : Json()).dump() +
          ",\n\"exposures\": [");
}

void DeblurReport::add(const ExposureReport& exposure) {
    // Names of files need not be UTF-8.
    write((first_ ? "\n" : ",\n") +
          describe(exposure).dump(-1, ' ', false, Json::error_handler_t::replace));
    first_ = false;
}

void DeblurReport::commit() {
    write("\n]\n}\n");
    writer_.close();
    output_.commit();
}

void DeblurReport::write(const std::string& text) {
    writer_.write({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
}

} // namespace ecir::cli
