#include "tools/stability/capture.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tools/simulate/recording.hpp"
#include "tools/simulate/scene.hpp"

namespace ecir::stability {
namespace {

/// A scene under a light that changes, with something in front of it.
class StagedScene : public sim::Scene {
public:
    StagedScene(sim::Scene& scene, const Setting& setting, double start_us)
        : scene_(scene), setting_(setting), start_us_(start_us) {}

    io::Image at(double time_us) override {
        io::Image frame = scene_.at(time_us);
        const double time = (time_us - start_us_) / static_cast<double>(setting_.exposure_us);
        if (setting_.disc) {
            cover(frame, *setting_.disc, time);
        }
        if (setting_.light) {
            const auto light = static_cast<float>(setting_.light(time));
            for (float& value : frame.pixels) {
                value *= light;
            }
        }
        return frame;
    }

    [[nodiscard]] std::vector<double> knots(double start_us, double end_us) const override {
        std::vector<double> times = scene_.knots(start_us, end_us);
        if (!setting_.disc) {
            return times;
        }
        // So many that the disc, too, moves under half a pixel between two.
        constexpr int samples = 512;
        double fastest = 0;
        for (int i = 0; i < samples; ++i) {
            const auto a = setting_.disc->centre(static_cast<double>(i) / samples);
            const auto b = setting_.disc->centre((i + 1.0) / samples);
            fastest = std::max(fastest, std::hypot(a[0] - b[0], a[1] - b[1]));
        }
        const double step =
            static_cast<double>(setting_.exposure_us) / (std::max(1.0, 2 * fastest) * samples);
        for (double time = start_us + step; time < end_us; time += step) {
            times.push_back(time);
        }
        std::ranges::sort(times);
        return times;
    }

private:
    /// Its edge is a pixel wide, as a pixel's area averages it.
    static void cover(io::Image& frame, const Disc& disc, double time) {
        const auto centre = disc.centre(time);
        for (int y = 0; y < frame.height; ++y) {
            for (int x = 0; x < frame.width; ++x) {
                const double u = x + 0.5 - frame.width / 2.0 - centre[0];
                const double v = y + 0.5 - frame.height / 2.0 - centre[1];
                const auto share = static_cast<float>(
                    std::clamp(disc.radius_px + 0.5 - std::hypot(u, v), 0.0, 1.0));
                if (share > 0) {
                    float& value =
                        frame.pixels[static_cast<size_t>(y) * static_cast<size_t>(frame.width) +
                                     static_cast<size_t>(x)];
                    value += share * (disc.brightness.value_or(texture(u, v)) - value);
                }
            }
        }
    }

    /// That of a thing which moves with its centre: two crossed gratings.
    static float texture(double u, double v) {
        return static_cast<float>(0.5 + 0.2 * std::sin(0.9 * u + 0.2 * v) +
                                  0.2 * std::cos(0.7 * v - 0.3 * u));
    }

    sim::Scene& scene_;
    const Setting& setting_;
    double start_us_;
};

std::vector<float> clipped(const io::Image& image) {
    std::vector<float> values = image.pixels;
    for (float& value : values) {
        value = std::clamp(value, 0.0F, 1.0F);
    }
    return values;
}

} // namespace

Setting nominal(const Subject& subject) {
    Setting setting;
    setting.motion.angle_deg = 25 + 90 * static_cast<double>(subject.seed - 1);
    setting.motion.seed = setting.camera.seed = subject.seed;
    return setting;
}

Capture capture(const Subject& subject, const Setting& setting) {
    const auto width = static_cast<int>(subject.width);
    const auto height = static_cast<int>(subject.height);
    const int lead = setting.before ? 1 : 0;
    const bool turning = setting.motion.path == sim::Path::reverse;
    const int parts = turning ? setting.turns : 1; // each a stretch of the path of its own
    sim::StillScene still(subject.picture, setting.motion, width, height,
                          static_cast<double>(setting.exposure_us) / parts, (1 + lead) * parts,
                          static_cast<int>(std::max(1U, subject.frames - 1)));
    const int64_t start = lead * setting.exposure_us;
    StagedScene scene(still, setting, static_cast<double>(start));
    sim::EventCamera camera(setting.camera, width, height);
    if (setting.before) {
        sim::expose(scene, camera, {0, start}, 1);
    }
    const sim::Shot shot = sim::expose(scene, camera, {start, start + setting.exposure_us},
                                       static_cast<int>(subject.frames));
    Capture result;
    result.width = subject.width;
    result.height = subject.height;
    result.exposure = {setting.start_us + start, setting.start_us + start + setting.exposure_us};
    result.events = camera.take(setting.start_us);
    result.blurry = clipped(shot.blurry);
    const auto levels = static_cast<float>((1 << setting.bits) - 1);
    for (float& value : result.blurry) {
        value = std::round(value * levels) / levels;
    }
    for (const io::Image& frame : shot.truth) {
        result.truth.push_back(clipped(frame));
    }
    return result;
}

Events sorted(const Events& events) {
    std::vector<size_t> order(events.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(order, {}, [&](size_t i) { return events.t[i]; });
    Events result;
    for (const size_t i : order) {
        result.push_back(events.t[i], events.x[i], events.y[i], events.p[i]);
    }
    return result;
}

Events filtered(const Events& events, const std::function<bool(size_t)>& keep) {
    Events result;
    for (size_t i = 0; i < events.size(); ++i) {
        if (keep(i)) {
            result.push_back(events.t[i], events.x[i], events.y[i], events.p[i]);
        }
    }
    return result;
}

Events retimed(const Events& events, const std::function<int64_t(int64_t)>& move) {
    Events result = events;
    std::ranges::transform(events.t, result.t.begin(), move);
    return sorted(result);
}

} // namespace ecir::stability
