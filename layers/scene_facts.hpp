#pragma once
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "layers/events.hpp"

namespace ecir {

/// What a blurry frame and its events tell before anything is computed from them: how much the
/// scene needs, and what in it the methods' assumptions do not hold for. On the host, in one pass
/// over the events and a few over the pixels.
struct SceneFacts {
    size_t events = 0;           ///< of the exposure
    double events_per_pixel = 0; ///< over the whole image
    double active_share = 0;     ///< of the pixels: those with at least one event
    double positive_share = 0;   ///< of the events
    double travel = 0;           ///< pixels, see estimate_travel()
    double white_share = 0;      ///< of the pixels: blurry frame at 0.98 or more
    double black_share = 0;      ///< of the pixels: blurry frame below 0.02
    double isolated_share = 0;   ///< of the events: no other pixel of the 3 x 3 around had one
    /// Of the events (the first 131,072) with an earlier one at the 8 pixels around: those whose
    /// latest has the same sign. At random a half; 0.75 to 0.98 in real and simulated scenes. 1
    /// where under 1000 have one.
    double agreeing_share = 1;
    size_t hot_pixels = 0; ///< very many events where all neighbours have few
    double flicker_hz = 0; ///< 100 or 120, whichever explains more; 0: exposure under 3 periods
    double flicker_share =
        0; ///< of the variance of the signed event rate that a sine of it explains
    double bunched_share = 0; ///< of the events, see bunched_share()
    int64_t longest_gap =
        0; ///< microseconds (1000 or more) without an event between two busy stretches as long
};

/// Share of the events that lie at the five microseconds with most of them: 0 for fewer than 200
/// events, and for exposures under a millisecond, where that tells nothing.
double bunched_share(const EventView& events, const Exposure& exposure);

/// blurry: height x width values, 0 ... 1. events: those of the exposure, sorted by time, inside
/// the image.
SceneFacts scene_facts(std::span<const float> blurry, const EventView& events,
                       const Exposure& exposure, uint32_t width, uint32_t height);

/// A condition under which the result may be worse than it looks.
struct SceneWarning {
    std::string name; ///< of the condition, for programs: lower case, no spaces
    std::string text; ///< what was found and what to do, for people
};

/// Motion, as SceneFacts::travel tells it, that a method is good for.
struct TravelRange {
    double least = 0; ///< below it the blurry frame is nearer to the truth
    double most = std::numeric_limits<double>::infinity();
};

/// Those that hold for a method. Their limits: layers/scene_facts.cpp.
std::vector<SceneWarning> scene_warnings(const SceneFacts& facts, const TravelRange& served);

/// The one of events that are `late_us` microseconds later against a frame than was assumed, where
/// what moves goes far in that time.
std::optional<SceneWarning> lag_warning(const SceneFacts& facts, const Exposure& exposure,
                                        double late_us);

} // namespace ecir
