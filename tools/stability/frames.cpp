#include "tools/stability/frames.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

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

/// Runs `figure` for each subject and makes the mean of it a sample; what throws or is not finite
/// becomes a failed one.
Sample gather(const Lab& lab, const std::string& series,
              const std::function<double(const Subject&, bool& finite)>& figure) {
    Sample sample{.series = series};
    double sum = 0;
    try {
        for (const Subject& subject : lab.subjects) {
            sum += figure(subject, sample.finite);
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

size_t place(const Lab& lab, const Subject& subject) {
    return static_cast<size_t>(&subject - lab.subjects.data());
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

std::vector<float> frames_of(const Lab& lab, const Method& method, const Capture& capture) {
    DeblurOptions options = method.options;
    if (method.told) {
        options.thresholds = capture.told;
    }
    Deblur deblur(lab.device, options, capture.width, capture.height);
    return deblur.frames(capture.blurry, capture.events.view(), capture.exposure,
                         even_times(static_cast<uint32_t>(capture.truth.size())));
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
    return !sample.failed || std::ranges::none_of(promises, [&](const Promise& promise) {
        return sample.series.starts_with(promise.series) && value >= promise.low &&
               value <= promise.high;
    });
}

std::vector<Sweep> all_sweeps() {
    std::vector<Sweep> all;
    for (const auto& group : {event_sweeps, sensor_sweeps, motion_sweeps, light_sweeps,
                              curve_sweeps, refinement_sweeps, precision_sweeps}) {
        for (Sweep& sweep : group()) {
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
        Sample blurry = gather(lab, "blurry frame", [&](const Subject& subject, bool&) {
            const Capture& seen = made[place(lab, subject)];
            std::vector<float> still;
            for (size_t i = 0; i < seen.truth.size(); ++i) {
                still.insert(still.end(), seen.blurry.begin(), seen.blurry.end());
            }
            return psnr(still, seen);
        });
        blurry.reference = true;
        blurry.signs = signs_of(made.front());
        samples.push_back(blurry);
        samples.push_back(
            {.series = "fails below", .value = blurry.value - kHarm, .reference = true});
        for (const Method& method : lab.methods) {
            Sample sample = gather(lab, method.name, [&](const Subject& subject, bool& all_finite) {
                const Capture& seen = made[place(lab, subject)];
                const auto frames = frames_of(lab, method, seen);
                all_finite = all_finite && finite(frames);
                return psnr(frames, seen);
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
            Sample sample = gather(lab, method.name, [&](const Subject& subject, bool& all_finite) {
                const Capture& seen = made[place(lab, subject)];
                auto frames = frames_of(lab, method, seen);
                auto expected = frames_of(lab, method, known[place(lab, subject)]);
                all_finite = all_finite && finite(frames);
                for (size_t i = 0; look && i < frames.size(); ++i) {
                    const auto pixel = static_cast<uint32_t>(i % seen.pixels());
                    if (!look(subject, pixel % seen.width, pixel / seen.width)) {
                        frames[i] = expected[i] = 0;
                    }
                }
                return rms_levels(frames, expected);
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
