#pragma once
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "layers/edi.hpp"
#include "layers/events.hpp"
#include "tools/io/image.hpp"
#include "tools/simulate/esim.hpp"
#include "tools/simulate/motion.hpp"

namespace ecir::stability {

/// One exposure with its truth, as a method gets it.
struct Capture {
    uint32_t width = 0;
    uint32_t height = 0;
    std::vector<float> blurry; ///< height x width
    Events events;
    Exposure exposure;
    std::vector<std::vector<float>> truth; ///< sharp frames at even times from -1 to 1
    std::optional<EdiThresholds> told;     ///< to methods that take thresholds; else estimated
    [[nodiscard]] size_t pixels() const { return size_t{width} * height; }
};

/// What a capture is made from, beside the condition that is swept.
struct Subject {
    io::Image picture; ///< grey
    uint64_t seed = 1; ///< of the camera and of the motion's direction
    uint32_t width = 128;
    uint32_t height = 96;
    uint32_t frames = 7; ///< of truth
};

/// Something in front of the picture.
struct Disc {
    double radius_px = 0;
    /// Its centre, pixels from the frame's, at a time of the exposure from 0 to 1.
    std::function<std::array<double, 2>(double)> centre;
    /// Its brightness, which may exceed 1: a lamp; unset: the picture's own texture, mirrored.
    std::optional<float> brightness{};
};

/// How a scene moves, is lit and is seen. The defaults are the nominal scene, which every method
/// improves.
struct Setting {
    sim::Motion motion{.path = sim::Path::linear, .travel_px = 12};
    int turns = 1; ///< of Path::reverse in the exposure
    sim::CameraModel camera{.positive = 0.2, .negative = 0.2};
    int64_t exposure_us = 120'000;
    int64_t start_us = 0;
    /// Brightness of the light at a time of the exposure from 0 to 1.
    std::function<double(double)> light;
    std::optional<Disc> disc;
    bool before = false; ///< events of as long a time before the exposure, too
    int bits = 8;        ///< of the blurry frame, whose values end at 1
};

/// The nominal scene of a subject: its seed sets camera, turn and direction.
Setting nominal(const Subject& subject);

/// Simulates it (ESIM, exact mean over the exposure). Throws what the simulator throws.
Capture capture(const Subject& subject, const Setting& setting);

/// The events in order of time, those of one time in their order.
Events sorted(const Events& events);

/// The events for which keep(index) holds, at the times that move(index) gives, sorted.
Events filtered(const Events& events, const std::function<bool(size_t)>& keep);
Events retimed(const Events& events, const std::function<int64_t(int64_t)>& move);

} // namespace ecir::stability
