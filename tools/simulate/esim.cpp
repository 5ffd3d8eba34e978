#include "tools/simulate/esim.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <tuple>

#include "runtime/error.hpp"

namespace ecir::sim {
namespace {

constexpr double never = std::numeric_limits<double>::infinity();

void check(const CameraModel& model, int width, int height) {
    const auto refuse = [](const char* message) { throw Error(ExitCode::usage, message); };
    const auto sensible = [](double value, double low, double high) {
        return value >= low && value <= high; // false for NaN
    };
    if (!sensible(model.positive, smallest_threshold, 100) ||
        !sensible(model.negative, smallest_threshold, 100)) {
        refuse("contrast thresholds must lie between 0.01 and 100");
    }
    if (!sensible(model.sigma, 0, 100)) {
        refuse("the thresholds' sigma must lie between 0 and 100");
    }
    if (!sensible(model.pixel_spread, 0, 10)) {
        refuse("the spread of the pixels' thresholds must lie between 0 and 10");
    }
    if (model.refractory_us < 0) {
        refuse("the refractory period must not be negative");
    }
    if (!sensible(model.noise_hz, 0, 1e6) || !sensible(model.hot_hz, 0, 1e6)) {
        refuse("noise rates must lie between 0 and 1000000 Hz");
    }
    if (!sensible(model.hot_fraction, 0, 1)) {
        refuse("the fraction of hot pixels must lie between 0 and 1");
    }
    if (width < 1 || height < 1 || width > 65536 || height > 65536) {
        refuse("an event camera has 1 to 65536 pixels a side");
    }
}

} // namespace

EventCamera::EventCamera(const CameraModel& model, int width, int height)
    : model_(model), width_(width), height_(height) {
    check(model, width, height);
    pixels_.resize(static_cast<size_t>(width) * static_cast<size_t>(height));
    for (size_t i = 0; i < pixels_.size(); ++i) {
        Pixel& pixel = pixels_[i];
        pixel.random = Random(model.seed, i);
        if (model.pixel_spread > 0) {
            // A stream of its own, so that noise and thresholds stay those of equal pixels.
            Random own(model.seed, i + pixels_.size());
            pixel.factor = std::max(1 + model.pixel_spread * own.normal(), 0.05);
        }
        pixel.positive = draw(pixel, model.positive);
        pixel.negative = draw(pixel, model.negative);
        const bool hot = pixel.random.uniform() <= model.hot_fraction && model.hot_fraction > 0;
        pixel.noise_rate = (model.noise_hz + (hot ? model.hot_hz : 0)) * 1e-6;
        pixel.last_event = -never;
    }
}

double EventCamera::draw(Pixel& pixel, double mean) const {
    mean *= pixel.factor;
    if (model_.sigma == 0) {
        return std::max(mean, smallest_threshold);
    }
    return std::max(mean + model_.sigma * pixel.random.normal(), smallest_threshold);
}

void EventCamera::see(std::span<const float> intensity, double time_us) {
    if (intensity.size() != pixels_.size()) {
        throw std::invalid_argument("EventCamera::see: the frame is not height x width");
    }
    if (!(time_us >= time_us_)) {
        throw std::invalid_argument("EventCamera::see: time goes back");
    }
    if (started_ && time_us == time_us_) {
        return;
    }
    for (uint32_t i = 0; i < pixels_.size(); ++i) {
        const double log = std::log(static_cast<double>(intensity[i]) + log_offset);
        if (started_) {
            advance(i, log, time_us);
        } else {
            Pixel& pixel = pixels_[i];
            pixel.log = pixel.reference = log;
            pixel.next_noise =
                pixel.noise_rate > 0 ? time_us + pixel.random.exponential(pixel.noise_rate) : never;
        }
    }
    started_ = true;
    time_us_ = time_us;
}

/// Crossings and noise of one pixel on the way to `log` at `time_us`, in the order of their times:
/// the refractory period makes it matter which came first.
void EventCamera::advance(uint32_t index, double log, double time_us) {
    Pixel& pixel = pixels_[index];
    const bool rising = log > pixel.log;
    const double step = log - pixel.log;
    for (;;) {
        const double level =
            rising ? pixel.reference + pixel.positive : pixel.reference - pixel.negative;
        const bool crossed = rising ? log >= level : log <= level;
        // The clamp: rounding may put a level that the last frame reached exactly before it.
        const double crossing =
            crossed && step != 0
                ? time_us_ + std::clamp((level - pixel.log) / step, 0.0, 1.0) * (time_us - time_us_)
                : never;
        if (std::min(crossing, pixel.next_noise) > time_us) {
            break;
        }
        if (crossing <= pixel.next_noise) {
            pixel.reference = level;
            (rising ? pixel.positive : pixel.negative) =
                draw(pixel, rising ? model_.positive : model_.negative);
            fire(index, crossing, rising);
        } else {
            const double time = pixel.next_noise;
            pixel.next_noise += pixel.random.exponential(pixel.noise_rate);
            fire(index, time, (pixel.random.bits() >> 63) != 0);
        }
    }
    pixel.log = log;
}

void EventCamera::fire(uint32_t index, double time_us, bool brighter) {
    Pixel& pixel = pixels_[index];
    if (time_us - pixel.last_event < static_cast<double>(model_.refractory_us)) {
        return;
    }
    pixel.last_event = time_us;
    fired_.push_back({std::llround(time_us), index, static_cast<uint8_t>(brighter ? 1 : 0)});
}

Events EventCamera::take(int64_t origin_us) {
    // Stable, because one pixel's events of one microsecond must stay in their order. The index
    // grows with (y, x).
    std::stable_sort(fired_.begin(), fired_.end(), [](const Fired& a, const Fired& b) {
        return std::tie(a.t, a.index) < std::tie(b.t, b.index);
    });
    Events events;
    events.t.reserve(fired_.size());
    events.x.reserve(fired_.size());
    events.y.reserve(fired_.size());
    events.p.reserve(fired_.size());
    const auto width = static_cast<uint32_t>(width_);
    for (const Fired& event : fired_) {
        events.push_back(origin_us + event.t, static_cast<uint16_t>(event.index % width),
                         static_cast<uint16_t>(event.index / width), event.p);
    }
    fired_.clear();
    return events;
}

} // namespace ecir::sim
