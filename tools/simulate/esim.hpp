#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/events.hpp"
#include "tools/simulate/random.hpp"

namespace ecir::sim {

/// The offset in log(I + eps): keeps black finite, and dark pixels from firing at every step.
inline constexpr double log_offset = 0.01;
/// No drawn contrast threshold is smaller.
inline constexpr double smallest_threshold = 0.01;

struct CameraModel {
    double positive = 0.18;    ///< c+ > 0, change of log intensity for a brighter event
    double negative = 0.18;    ///< c- > 0 (its size), for a darker event
    double sigma = 0.03;       ///< spread of both, drawn anew for each event
    double pixel_spread = 0;   ///< of a pixel's own thresholds, relative to c+ and c-
    int64_t refractory_us = 0; ///< a pixel gives no second event sooner than this
    double noise_hz = 0;       ///< background events a second for every pixel
    double hot_fraction = 0;   ///< share of pixels, in [0, 1], that fire at hot_hz besides
    double hot_hz = 500;
    uint64_t seed = 1;
};

/// An event camera after ESIM (Rebecq et al., CoRL 2018). Each pixel keeps a reference r of the log
/// intensity l = log(I + eps), which is taken as linear in time between two frames, and at
///     l >= r + C+  gives a brighter event, r += C+,     C+ ~ max(N(c+, sigma), 0.01)
///     l <= r - C-  gives a darker event,   r -= C-,     C- ~ max(N(c-, sigma), 0.01)
/// where c+ and c- are a pixel's own, which vary by pixel_spread.
/// A crossing inside the refractory period moves r and gives no event. Noise and hot pixels are
/// Poisson processes of either sign with equal chance; they leave r alone.
/// Equal model, size and frames give equal events.
class EventCamera {
public:
    /// Throws Error(usage) when the model or the size (1 to 65536 a side) is out of range.
    EventCamera(const CameraModel& model, int width, int height);

    /// Shows the camera the next frame: height x width intensities in [0, 1] at `time_us` >= 0
    /// microseconds. The first sets the references; one at the same time as the last is ignored.
    /// Throws std::invalid_argument when the size differs or the time goes back.
    void see(std::span<const float> intensity, double time_us);

    /// The events so far, sorted by (t, y, x), times rounded to microseconds with `origin_us`
    /// added; the camera then holds none.
    Events take(int64_t origin_us);

private:
    struct Pixel {
        Random random;
        double log = 0;       ///< log intensity at the last frame
        double reference = 0; ///< r
        double positive = 0;  ///< the next C+ and C-
        double negative = 0;
        double factor = 1;     ///< of its own thresholds over the mean ones
        double next_noise = 0; ///< microseconds
        double noise_rate = 0; ///< events a microsecond
        double last_event = 0;
    };
    struct Fired {
        int64_t t;
        uint32_t index;
        uint8_t p;
    };
    /// The next threshold of a pixel whose thresholds lie about `mean` times its factor.
    double draw(Pixel& pixel, double mean) const;
    void advance(uint32_t index, double log, double time_us);
    void fire(uint32_t index, double time_us, bool brighter);

    CameraModel model_;
    int width_;
    int height_;
    bool started_ = false;
    double time_us_ = 0;
    std::vector<Pixel> pixels_;
    std::vector<Fired> fired_;
};

} // namespace ecir::sim
