#include "layers/deblur.hpp"

#include <algorithm>
#include <numeric>

#include "layers/ecir.hpp"
#include "layers/edi_method.hpp"
#include "layers/esl_net.hpp"
#include "layers/fusion.hpp"
#include "runtime/error.hpp"
#include "weights/safetensors.hpp"

namespace ecir {
namespace {

constexpr double kIntensityOffset = 0.01; ///< e: keeps ratios and logarithms of dark pixels finite

/// For methods that E-CIR's options mean nothing to.
void refuse_ecir_options(const std::string& method, const DeblurOptions& options) {
    if (options.refine || options.keypoints) {
        throw Error(ExitCode::usage,
                    method + " has neither keypoints nor a refinement; leave --keypoints and "
                             "--refine out");
    }
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

std::unique_ptr<Method> make_method(std::shared_ptr<Device> device, const DeblurOptions& options,
                                    uint32_t width, uint32_t height) {
    if (options.thresholds) {
        check_thresholds(*options.thresholds);
    }
    if (options.model == "edi") {
        refuse_ecir_options("edi", options);
        return std::make_unique<EdiMethod>(std::move(device), height, width, options.thresholds);
    }
    const SafeTensors weights(find_model(options.model));
    const std::string kind = weights.meta("model");
    if (kind == "fusion") {
        if (options.keypoints) {
            throw Error(ExitCode::usage, "model " + options.model +
                                             ", a fusion network, has no keypoints; leave "
                                             "--keypoints out");
        }
        if (options.refine.value_or(1) > 1) {
            throw Error(ExitCode::usage,
                        "model " + options.model +
                            ", a fusion network, corrects its prior once; "
                            "--refine " +
                            std::to_string(*options.refine) +
                            " is for ecir models; give 1, or 0 for the prior alone, or leave "
                            "--refine out");
        }
        return std::make_unique<FusionMethod>(std::move(device), weights, height, width,
                                              options.thresholds, options.refine.value_or(1) > 0);
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
        return std::make_unique<EslNetMethod>(std::move(device), weights, height, width);
    }
    const EcirConfig config(weights);
    if (options.keypoints && *options.keypoints != config.keypoints) {
        throw Error(ExitCode::usage, "model " + options.model + " was trained for " +
                                         std::to_string(config.keypoints) + " keypoints, not " +
                                         std::to_string(*options.keypoints) +
                                         "; leave --keypoints out or use another model (-m)");
    }
    return std::make_unique<EcirMethod>(std::move(device), weights, height, width, options.refine);
}

} // namespace

Deblur::Deblur(std::shared_ptr<Device> device, const DeblurOptions& options, uint32_t width,
               uint32_t height)
    : method_(make_method(std::move(device), options, width, height)), width_(width),
      height_(height) {}
Deblur::~Deblur() = default;
Deblur::Deblur(Deblur&&) noexcept = default;

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
    if (seen.size() == 0) {
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
    const FrameFacts facts = method_->begin({blurry, seen, exposure, ascending});
    begun.thresholds = facts.thresholds;
    begun.ignored_pixels = facts.ignored_pixels;
    begun_.push_back(std::move(begun));
}

std::vector<float> Deblur::finish() {
    Begun begun = std::move(begun_.at(0));
    begun_.erase(begun_.begin());
    thresholds_ = begun.thresholds;
    ignored_pixels_ = begun.ignored_pixels;
    if (begun.order.empty()) {
        return std::move(begun.still);
    }
    const size_t pixels = size_t{width_} * height_;
    const auto frames = method_->finish();
    std::vector<float> result(begun.order.size() * pixels);
    for (size_t i = 0; i < begun.order.size(); ++i) {
        std::ranges::copy(frames.subspan(i * pixels, pixels),
                          result.begin() + static_cast<std::ptrdiff_t>(begun.order[i] * pixels));
    }
    return result;
}

double Deblur::operations() const {
    return method_->operations();
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
