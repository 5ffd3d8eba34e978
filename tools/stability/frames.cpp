#include "tools/stability/frames.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>

#include "layers/frame_lag.hpp"
#include "layers/scene_facts.hpp"
#include "runtime/error.hpp"
#include "weights/safetensors.hpp"

namespace ecir::stability {
namespace {

constexpr double kHarm = 0.5; ///< dB below the blurry frame
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::string text(const char* format, double value) {
    char result[128];
    std::snprintf(result, sizeof result, format, value);
    return result;
}

double mean_square(std::span<const float> a, std::span<const float> b) {
    double sum = 0;
    for (size_t i = 0; i < a.size(); ++i) {
        const double difference =
            double{std::clamp(a[i], 0.0F, 1.0F)} - std::clamp(b[i], 0.0F, 1.0F);
        sum += difference * difference;
    }
    return sum / static_cast<double>(a.size());
}

bool finite(std::span<const float> values) {
    return std::ranges::all_of(values, [](float value) { return std::isfinite(value); });
}

/// Runs `figure` for each subject, by its index, and makes the mean of it a sample; what throws or
/// is not finite becomes a failed one.
Sample gather(const Lab& lab, const std::string& series,
              const std::function<double(size_t, Sample&)>& figure) {
    Sample sample{.series = series};
    double sum = 0;
    try {
        for (size_t i = 0; i < lab.subjects.size(); ++i) {
            sum += figure(i, sample);
        }
        sample.value = sum / static_cast<double>(lab.subjects.size());
    } catch (const Error& error) {
        sample.value = kNone;
        sample.refused = error.code() == ExitCode::bad_input || error.code() == ExitCode::usage;
        sample.failed = true;
        sample.finite = sample.refused; // else nothing is known of it
        sample.how = std::string(sample.refused ? "refused: " : "failed: ") + error.what();
        return sample;
    }
    if (!sample.finite) {
        sample.value = kNone;
        sample.failed = true;
        sample.how = "a value that is not finite";
    }
    return sample;
}

/// The captures of a value, made once for all methods.
std::vector<Capture> captures(const Lab& lab, const Make& make, double value) {
    std::vector<Capture> made;
    for (const Subject& subject : lab.subjects) {
        made.push_back(make(subject, value));
    }
    return made;
}

/// Adds what was found for the next subject; where one is not warned of, none is.
void add(Sample& sample, const Found& found) {
    sample.finite = sample.finite && finite(found.frames);
    if (!sample.warned) {
        sample.warned = found.warnings;
        return;
    }
    if (sample.warned->empty() || found.warnings.empty()) {
        sample.warned->clear();
        return;
    }
    for (const std::string& name : found.warnings) {
        if (std::ranges::find(*sample.warned, name) == sample.warned->end()) {
            sample.warned->push_back(name);
        }
    }
}

} // namespace

std::vector<Method> methods_of(const std::vector<std::string>& models) {
    std::vector<Method> methods;
    for (const std::string& model : models) {
        const std::string kind =
            model == "edi" ? "edi" : SafeTensors(find_model(model)).meta("model");
        DeblurOptions options;
        options.model = model;
        const std::string name = kind == "esl_net" ? "eSL-Net" : model;
        if (kind == "ecir") {
            methods.push_back({name + ", refined", options, false});
            options.refine = 0;
            methods.push_back({name + ", curve", options, false});
        } else {
            methods.push_back({name, options, kind == "edi" || kind == "fusion"});
        }
    }
    return methods;
}

Found find_frames(const Lab& lab, const Method& method, const Capture& capture) {
    DeblurOptions options = method.options;
    if (method.told) {
        options.thresholds = capture.told;
    }
    Deblur deblur(lab.device, options, capture.width, capture.height);
    const EventView events = window(capture.events.view(), capture.exposure);
    Found found{deblur.frames(capture.blurry, events, capture.exposure,
                              even_times(static_cast<uint32_t>(capture.truth.size()))),
                {}};
    const SceneFacts facts =
        scene_facts(capture.blurry, events, capture.exposure, capture.width, capture.height);
    for (const SceneWarning& warning : scene_warnings(facts, deblur.travel_range())) {
        found.warnings.push_back(warning.name);
    }
    FrameLagEstimator lags(*lab.device, capture.width, capture.height);
    const auto lag = lags.estimate(capture.blurry, capture.events.view(), capture.exposure, 0);
    if (lag && lag_warning(facts, capture.exposure, *lag)) {
        found.warnings.push_back("late");
    }
    return found;
}

double rms_levels(std::span<const float> a, std::span<const float> b) {
    return 255 * std::sqrt(mean_square(a, b));
}

double psnr(std::span<const float> frames, const Capture& capture) {
    double sum = 0;
    const size_t pixels = capture.pixels();
    for (size_t i = 0; i < capture.truth.size(); ++i) {
        sum += mean_square(frames.subspan(i * pixels, pixels), capture.truth[i]);
    }
    constexpr double rounding = 1.0 / (12.0 * 255 * 255);
    return -10 * std::log10(sum / static_cast<double>(capture.truth.size()) + rounding);
}

bool Sweep::holds(const Sample& sample, double value) const {
    if (!sample.finite) {
        return false;
    }
    const bool warned =
        sample.warned && std::ranges::any_of(*sample.warned, [&](const std::string& warning) {
            return std::ranges::find(warnings, warning) != warnings.end();
        });
    return !sample.failed || warned || std::ranges::none_of(promises, [&](const Promise& promise) {
        return sample.series.starts_with(promise.series) && value >= promise.low &&
               value <= promise.high;
    });
}

std::vector<Sweep> all_sweeps() {
    struct Group {
        std::vector<Sweep> (*make)();
        std::vector<std::string> warnings;
    };
    const std::array groups = {
        Group{event_sweeps, {"no-events", "one-sign", "noise", "hot-pixels", "bunched", "gap"}},
        Group{sensor_sweeps, {"one-sign", "noise", "hot-pixels", "bunched", "gap"}},
        Group{motion_sweeps, {"slow", "fast"}},
        Group{light_sweeps, {"saturated", "dark", "one-sign", "flicker"}},
        Group{curve_sweeps, {}},
        Group{refinement_sweeps, {}},
        Group{precision_sweeps, {}}};
    std::vector<Sweep> all;
    for (const Group& group : groups) {
        for (Sweep& sweep : group.make()) {
            if (sweep.warnings.empty()) {
                sweep.warnings = group.warnings;
            }
            all.push_back(std::move(sweep));
        }
    }
    return all;
}

Sweep against_blurry(Sweep sweep, Make make) {
    sweep.y = {"PSNR, dB"};
    sweep.fails = "PSNR over 0.5 dB below the blurry frame's, or a value that is not finite";
    sweep.measure = [make = std::move(make)](const Lab& lab, double value) {
        const std::vector<Capture> made = captures(lab, make, value);
        std::vector<Sample> samples;
        Sample blurry = gather(lab, "blurry frame", [&](size_t i, Sample&) {
            const Capture& seen = made[i];
            std::vector<float> still;
            for (size_t k = 0; k < seen.truth.size(); ++k) {
                still.insert(still.end(), seen.blurry.begin(), seen.blurry.end());
            }
            return psnr(still, seen);
        });
        blurry.reference = true;
        samples.push_back(blurry);
        samples.push_back(
            {.series = "fails below", .value = blurry.value - kHarm, .reference = true});
        for (const Method& method : lab.methods) {
            Sample sample = gather(lab, method.name, [&](size_t i, Sample& whole) {
                const Found found = find_frames(lab, method, made[i]);
                add(whole, found);
                return psnr(found.frames, made[i]);
            });
            if (sample.value < blurry.value - kHarm) {
                sample.failed = true;
                sample.how = text("%.1f dB below the blurry frame", blurry.value - sample.value);
            }
            samples.push_back(sample);
        }
        return samples;
    };
    return sweep;
}

Sweep against_same(Sweep sweep, const Make& make, const Make& same,
                   const std::function<bool(const Subject&, uint32_t, uint32_t)>& look) {
    const double limit = sweep.limit.value_or(1);
    sweep.limit = limit;
    sweep.y = {"RMS difference, grey levels"};
    sweep.fails = text("frames over %g grey levels (RMS) from those without the condition, or a "
                       "value that is not finite",
                       limit);
    sweep.measure = [=](const Lab& lab, double value) {
        const std::vector<Capture> made = captures(lab, make, value);
        const std::vector<Capture> known = captures(lab, same, value);
        std::vector<Sample> samples;
        for (const Method& method : lab.methods) {
            Sample sample = gather(lab, method.name, [&](size_t i, Sample& whole) {
                const Capture& seen = made[i];
                Found found = find_frames(lab, method, seen);
                add(whole, found);
                auto expected = find_frames(lab, method, known[i]).frames;
                for (size_t k = 0; look && k < expected.size(); ++k) {
                    const auto pixel = static_cast<uint32_t>(k % seen.pixels());
                    if (!look(lab.subjects[i], pixel % seen.width, pixel / seen.width)) {
                        found.frames[k] = expected[k] = 0;
                    }
                }
                return rms_levels(found.frames, expected);
            });
            if (sample.value > limit) {
                sample.failed = true;
                sample.how = text("%.2g grey levels off", sample.value);
            }
            samples.push_back(sample);
        }
        return samples;
    };
    return sweep;
}

} // namespace ecir::stability
