#include <algorithm>
#include <cmath>
#include <cstdio>

#include "tools/stability/frames.hpp"
#include "tools/stability/stages.hpp"
#include "tools/stability/weights_copy.hpp"

// Half precision as a form of storage: what each border between two stages loses by it.

namespace ecir::stability {
namespace {

struct Stage {
    const char* label = "";
    Border border = Border::none;
    EdiBorder edi = EdiBorder::none;
};

constexpr Stage kStages[] = {
    {"blurry frame", Border::blurry},
    {"event counts", Border::histogram},
    {"keypoints into U-Net", Border::network},
    {"weights", Border::weights},
    {"dL/dt", Border::derivatives},
    {"keypoints into curve", Border::keypoints},
    {"nodes, integrals", Border::matrix},
    {"curve's frames", Border::initial},
    {"refined frames", Border::refined},
    {"EDI: times", Border::none, EdiBorder::times},
    {"EDI: sum of events", Border::none, EdiBorder::sum},
    {"EDI: integral", Border::none, EdiBorder::integral},
};

/// Largest difference, and root mean square, as samples.
void compare(std::vector<Sample>& samples, const std::string& name, std::span<const float> stored,
             std::span<const float> exact) {
    Sample largest{.series = name + ": largest"};
    for (size_t i = 0; i < stored.size(); ++i) {
        largest.finite = largest.finite && std::isfinite(stored[i]);
        largest.value = std::max(largest.value, 255.0 * std::abs(std::clamp(stored[i], 0.0F, 1.0F) -
                                                                 std::clamp(exact[i], 0.0F, 1.0F)));
    }
    Sample rms{.series = name + ": RMS", .value = rms_levels(stored, exact)};
    rms.finite = largest.finite;
    for (Sample* sample : {&largest, &rms}) {
        sample->failed = !(sample->value <= 1) || !sample->finite;
        char text[64];
        std::snprintf(text, sizeof text, "%.3g grey levels off", sample->value);
        sample->how = sample->failed ? text : "";
        samples.push_back(*sample);
    }
}

/// A disc that crosses the frame: fast parts with many events beside slow ones.
Capture scene(const Subject& subject) {
    Setting setting = nominal(subject);
    setting.camera.positive = setting.camera.negative = 0.1;
    const double width = subject.width;
    setting.disc = Disc{.radius_px = 0.12 * width, .centre = [width](double time) {
                            return std::array<double, 2>{(time - 0.5) * width, 0.0};
                        }};
    return capture(subject, setting);
}

std::vector<Sample> stored_as_half(const Lab& lab, double value) {
    const Stage& stage = kStages[static_cast<size_t>(value)];
    const Subject& subject = lab.subjects.front();
    const Capture seen = scene(subject);
    const auto times = even_times(subject.frames);
    const FrameInput input{seen.blurry, seen.events.view(), seen.exposure, times};
    std::vector<Sample> samples;
    if (stage.edi != EdiBorder::none) {
        const EdiThresholds thresholds{0.1F, 0.1F};
        compare(samples, "edi", staged_edi(input, seen.width, seen.height, thresholds, stage.edi),
                staged_edi(input, seen.width, seen.height, thresholds, EdiBorder::none));
        return samples;
    }
    for (const Method& method : lab.methods) {
        if (!method.name.ends_with(", refined")) {
            continue;
        }
        const SafeTensors weights(find_model(method.options.model));
        const StagedFrames exact =
            StagedEcir(*lab.device, weights, seen.width, seen.height).frames(input, Border::none);
        StagedFrames stored;
        if (stage.border == Border::weights) {
            const WeightsCopy halves(
                weights, [](const std::string&, float weight) { return rounded_to_half(weight); });
            stored = StagedEcir(*lab.device, SafeTensors(halves.path()), seen.width, seen.height)
                         .frames(input, Border::none);
        } else {
            stored = StagedEcir(*lab.device, weights, seen.width, seen.height)
                         .frames(input, stage.border);
        }
        if (stage.border != Border::refined) {
            compare(samples, method.options.model + ", curve", stored.curve, exact.curve);
        }
        compare(samples, method.name, stored.refined, exact.refined);
    }
    return samples;
}

} // namespace

std::vector<Sweep> precision_sweeps() {
    Sweep half{.name = "precision-half",
               .title = "Values stored in half precision between two stages",
               .x = {"what is stored as float16"},
               .y = {"difference to float32, grey levels", cli::svg::Spread::logarithmic}};
    for (const Stage& stage : kStages) {
        half.labels.emplace_back(stage.label);
        half.values.push_back(static_cast<double>(half.values.size()));
    }
    half.quick = half.values;
    half.limit = 1;
    half.fails = "a pixel of a frame over one grey level from the all-float32 one's";
    half.safe = "everything between stages is float32; only weights, which are trained in it, may "
                "be stored as float16";
    half.promises = {{"ecir, refined", 0, 8}, {"ecir, curve", 0, 4}}; // as numbered above
    half.measure = stored_as_half;
    return {half};
}

} // namespace ecir::stability
