#include "layers/deblur.hpp"

#include <algorithm>
#include <numeric>

#include "layers/ecir.hpp"
#include "layers/edi_method.hpp"
#include "layers/edi_threshold.hpp"
#include "layers/esl_net.hpp"
#include "layers/fusion.hpp"
#include "layers/travel.hpp"
#include "layers/windowed.hpp"
#include "runtime/error.hpp"
#include "weights/safetensors.hpp"

namespace ecir {
namespace {

constexpr double kIntensityOffset = 0.01; ///< e: keeps ratios and logarithms of dark pixels finite

/// Pixels around what moves that a network sees (RegionRule::context): with them what is kept
/// differs from the whole image's by less than a tenth of a grey level.
constexpr uint32_t kFusionContext = 56;
constexpr uint32_t kEcirContext = 88;
constexpr uint32_t kEslNetContext = 56;
constexpr uint32_t kFade = 8; ///< pixels (RegionRule::fade)

/// A fusion network also sees where its pixels come from and go to: from some 16 pixels of travel
/// on it needs more around. Estimates are short by up to a third in fast scenes.
uint32_t fusion_context(double travel) {
    constexpr double kReach = 32;
    constexpr double kShort = 1.5;
    constexpr double kMost = 192;
    return std::max(kFusionContext,
                    static_cast<uint32_t>(std::min(kReach + kShort * travel, kMost)));
}

/// As estimated; shipped networks were trained up to 100 pixels.
constexpr TravelRange kTrained{.most = 80};
/// The published weights reach 20 dB in slow scenes, where a frame blurred by less has more.
constexpr double kLeastForEslNet = 5;

/// For methods without E-CIR's curve and refinement; what turns things off they do anyway.
void refuse_curve_options(const std::string& method, const DeblurOptions& options) {
    if (options.refine_until.value_or(0) > 0) {
        throw Error(ExitCode::usage, method + " has no iterations that could end early; leave "
                                              "--refine-until out");
    }
    if (options.ordered) {
        throw Error(ExitCode::usage,
                    method + " has no curve whose order could follow the events; leave --order "
                             "out");
    }
}

/// For methods that E-CIR's options mean nothing to.
void refuse_ecir_options(const std::string& method, const DeblurOptions& options) {
    if (options.refine || options.keypoints) {
        throw Error(ExitCode::usage,
                    method + " has neither keypoints nor a refinement; leave --keypoints and "
                             "--refine out");
    }
    refuse_curve_options(method, options);
}

/// Kernels find places in memory by what they compute of these values.
void check_values(std::span<const float> blurry, uint32_t width) {
    constexpr float kRounding = 1e-5F;
    const auto bad = std::ranges::find_if_not(
        blurry, [](float value) { return value >= -kRounding && value <= 1 + kRounding; });
    if (bad != blurry.end()) {
        const auto pixel = static_cast<size_t>(bad - blurry.begin());
        throw Error(ExitCode::bad_input, "the blurry frame's pixel at x " +
                                             std::to_string(pixel % width) + ", y " +
                                             std::to_string(pixel / width) + " is " +
                                             std::to_string(*bad) + "; luminance runs from 0 to 1");
    }
}

/// Thresholds as the command line takes them.
void check_thresholds(const EdiThresholds& thresholds) {
    for (const float value : {thresholds.positive, thresholds.negative}) {
        if (!(value >= 0.001F && value <= 10)) {
            throw Error(ExitCode::usage, "contrast threshold " + std::to_string(value) +
                                             " is not a number from 0.001 to 10");
        }
    }
}

} // namespace

Deblur::Model Deblur::make_model(const std::string& name) const {
    DeblurOptions options = options_;
    options.model = name;
    if (options.model == "edi") {
        refuse_ecir_options("edi", options);
        return {.method = std::make_unique<EdiMethod>(device_, height_, width_),
                .rule = {},
                .pixel_by_pixel = true,
                .has_thresholds = true};
    }
    const SafeTensors weights(find_model(options.model));
    const std::string kind = weights.meta("model");
    if (kind == "fusion") {
        if (options.keypoints) {
            throw Error(ExitCode::usage, "model " + options.model +
                                             ", a fusion network, has no keypoints; leave "
                                             "--keypoints out");
        }
        const uint32_t refine = options.refine.value_or(static_cast<uint32_t>(FusionSteps::agreed));
        if (refine > static_cast<uint32_t>(FusionSteps::agreed)) {
            throw Error(ExitCode::usage,
                        "model " + options.model +
                            ", a fusion network, refines its prior twice, by correction and by "
                            "agreement across time; --refine " +
                            std::to_string(refine) +
                            " is for ecir models; give 0, 1 or 2, or leave --refine out");
        }
        refuse_curve_options("model " + options.model + ", a fusion network,", options);
        const auto steps = static_cast<FusionSteps>(refine);
        const bool correct = steps != FusionSteps::prior;
        return {.method = std::make_unique<FusionMethod>(device_, weights, height_, width_, steps),
                .rule = correct ? RegionRule{kFusionContext, kFade} : RegionRule{},
                .pixel_by_pixel = !correct,
                .has_thresholds = true,
                .follows_motion = correct,
                .ignores_busy_pixels = true,
                .travel = correct ? kTrained : TravelRange{}};
    }
    if (kind != "ecir" && kind != "esl_net") {
        throw Error(ExitCode::bad_input,
                    "weights file " + weights.path().string() + " is of a model '" + kind +
                        "', which this version does not run; it runs ecir, esl_net and fusion");
    }
    if (options.thresholds) {
        throw Error(ExitCode::usage, "--threshold is for -m edi and fusion networks; model " +
                                         options.model +
                                         " has learned its thresholds; leave --threshold out");
    }
    if (kind == "esl_net") {
        refuse_ecir_options("model " + options.model + ", an eSL-Net,", options);
        return {.method = std::make_unique<EslNetMethod>(device_, weights, height_, width_),
                .rule = {kEslNetContext, kFade},
                .travel = {kLeastForEslNet, kTrained.most}};
    }
    const EcirConfig config(weights);
    if (options.keypoints && *options.keypoints != config.keypoints) {
        throw Error(ExitCode::usage, "model " + options.model + " was trained for " +
                                         std::to_string(config.keypoints) + " keypoints, not " +
                                         std::to_string(*options.keypoints) +
                                         "; leave --keypoints out or use another model (-m)");
    }
    return {.method = std::make_unique<EcirMethod>(
                device_, weights, height_, width_,
                EcirOptions{options.refine, options.refine_until, options.ordered}),
            .rule = {kEcirContext, kFade},
            .local = !config.release,
            .ignores_busy_pixels = !config.release,
            .travel = kTrained};
}

Deblur::Deblur(std::shared_ptr<Device> device, const DeblurOptions& options, uint32_t width,
               uint32_t height)
    : device_(std::move(device)), options_(options), width_(width), height_(height) {
    if (options.thresholds) {
        check_thresholds(*options.thresholds);
    }
    if (!(options.refine_until.value_or(0) >= 0)) {
        throw Error(ExitCode::usage, "--refine-until takes grey levels, 0 or more");
    }
    if (options.model == "auto") {
        family_ = ModelFamily::shipped();
        std::string known;
        for (const auto& each : family_->members()) {
            members_.push_back({each.model, {}, nullptr});
            known += (known.empty() ? "" : ", ") + each.model;
            if (each.model == options.largest) {
                break;
            }
        }
        if (!options.largest.empty() && members_.back().name != options.largest) {
            throw Error(ExitCode::usage,
                        "'" + options.largest +
                            "' is not a model that auto chooses from; these are: " + known);
        }
    } else {
        members_.push_back({options.model, {}, nullptr});
    }
    const Member& last = member(members_.size() - 1); // says at once what is wrong with it
    if (last.model.has_thresholds) {
        source_ = std::make_unique<EdiThresholdSource>(*device_, width, height, options.thresholds);
    }
}
Deblur::~Deblur() = default;
Deblur::Deblur(Deblur&&) noexcept = default;

Deblur::Member& Deblur::member(size_t index) {
    Member& found = members_.at(index);
    if (!found.method) {
        Model model = make_model(found.name);
        found.method = std::make_unique<WindowedMethod>(std::move(model.method), width_, height_);
        found.model = std::move(model);
    }
    return found;
}

size_t Deblur::choose_member(const EventView& events, double active_share) const {
    if (!family_) {
        return 0;
    }
    const double moving = active_share * width_ * height_;
    return family_->choose(static_cast<double>(events.size()) / std::max(moving, 1.0),
                           options_.quality, members_.size());
}

Regions Deblur::find_work(const Model& model, std::span<const float> blurry,
                          const EventView& events, const Exposure& exposure,
                          double& active_share) const {
    const PixelRect all{0, 0, width_, height_};
    if (!model.local) {
        active_share = 1;
        return {{{all, all}}, {}};
    }
    const ActivityMap map = model.pixel_by_pixel ? touched_cells(events, width_, height_)
                                                 : moving_cells(events, exposure, width_, height_);
    active_share = map.share();
    Regions regions = find_regions(map, model.rule, width_, height_);
    if (regions.windows.empty() || regions.whole(width_, height_)) {
        return regions;
    }
    if (model.follows_motion) {
        const RegionRule rule{
            fusion_context(estimate_travel(blurry, events, exposure, width_, height_)),
            model.rule.fade};
        regions = find_regions(map, rule, width_, height_);
    }
    if (!options_.regions) {
        regions.windows = {{all, all}};
    }
    return regions;
}

std::vector<float> Deblur::frames(std::span<const float> blurry, const EventView& events,
                                  const Exposure& exposure, std::span<const double> times) {
    begin(blurry, events, exposure, times);
    return finish();
}

void Deblur::begin(std::span<const float> blurry, const EventView& events, const Exposure& exposure,
                   std::span<const double> times) {
    const size_t pixels = size_t{width_} * height_;
    if (blurry.size() != pixels) {
        throw Error(ExitCode::bad_input, "the blurry frame has " + std::to_string(blurry.size()) +
                                             " values, " + std::to_string(width_) + "x" +
                                             std::to_string(height_) + " needs " +
                                             std::to_string(pixels));
    }
    for (const double time : times) {
        if (!(time >= -1 && time <= 1)) {
            throw Error(ExitCode::usage, "time " + std::to_string(time) +
                                             " is outside the exposure, which is -1 to 1");
        }
    }
    Begun begun;
    if (times.empty()) {
        begun_.push_back(std::move(begun));
        return;
    }
    check_values(blurry, width_);
    const EventView seen = window(events, exposure);
    Regions regions;
    if (seen.size() > 0) {
        check_events(seen, exposure, width_, height_);
        // All members see what moves alike.
        const Model& model = member(members_.size() - 1).model;
        regions = find_work(model, blurry, seen, exposure, begun.active_share);
        begun.member = choose_member(seen, begun.active_share);
        if (model.ignores_busy_pixels) {
            begun.ignored_pixels = prior_busy_pixels(seen, width_, height_);
        }
    }
    if (regions.windows.empty()) {
        begun.still.reserve(times.size() * pixels);
        for (size_t i = 0; i < times.size(); ++i) {
            begun.still.insert(begun.still.end(), blurry.begin(), blurry.end());
        }
        begun_.push_back(std::move(begun));
        return;
    }
    begun.order.resize(times.size());
    std::iota(begun.order.begin(), begun.order.end(), size_t{0});
    std::ranges::stable_sort(begun.order, {}, [&](size_t i) { return times[i]; });
    std::vector<double> ascending;
    ascending.reserve(times.size());
    for (const size_t i : begun.order) {
        ascending.push_back(times[i]);
    }
    begun_.reserve(begun_.size() + 1); // nothing may fail once the method has begun
    FrameInput input{blurry, seen, exposure, ascending};
    if (source_) {
        input.thresholds = source_->choose(seen, exposure, blurry);
        begun.thresholds = input.thresholds;
    }
    for (const Window& part : regions.windows) {
        begun.windows.push_back(part.computed);
    }
    WindowedMethod& method = *member(begun.member).method;
    method.begin(input, regions);
    operations_ = method.operations();
    begun_.push_back(std::move(begun));
}

std::vector<float> Deblur::finish() {
    Begun begun = std::move(begun_.at(0));
    begun_.erase(begun_.begin());
    thresholds_ = begun.thresholds;
    ignored_pixels_ = begun.ignored_pixels;
    active_share_ = begun.active_share;
    computed_ = std::move(begun.windows);
    if (begun.order.empty()) {
        used_.clear();
        work_.clear();
        return std::move(begun.still);
    }
    const Member& made = members_[begun.member];
    used_ = made.name;
    auto frames = made.method->finish(begun.order);
    work_ = made.method->work();
    return frames;
}

std::vector<double> even_times(uint32_t count) {
    std::vector<double> times(count);
    for (uint32_t i = 0; i < count; ++i) {
        times[i] = count == 1 ? 0.0 : -1 + 2.0 * i / (count - 1);
    }
    return times;
}

std::vector<float> recolour(std::span<const float> blurry, std::span<const float> luminance_blurry,
                            std::span<const float> luminance, uint32_t channels) {
    std::vector<float> result(blurry.size());
    for (size_t pixel = 0; pixel < luminance.size(); ++pixel) {
        const double ratio =
            (luminance[pixel] + kIntensityOffset) / (luminance_blurry[pixel] + kIntensityOffset);
        for (size_t c = 0; c < channels; ++c) {
            const size_t i = pixel * channels + c;
            result[i] =
                static_cast<float>((blurry[i] + kIntensityOffset) * ratio - kIntensityOffset);
        }
    }
    return result;
}

} // namespace ecir
