#include "layers/ecir.hpp"

#include <algorithm>
#include <charconv>

#include "layers/curve.hpp"
#include "layers/keypoints.hpp"
#include "layers/operations.hpp"
#include "layers/prior.hpp"
#include "layers/shapes.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

constexpr uint32_t kMostBins = 1024;
constexpr uint32_t kMostIterations = 1000;
constexpr float kSettled = 0.25F; ///< grey levels
constexpr float kBright = 0.5F;   ///< least 99th percentile of a frame that stays as it is

[[noreturn]] void fail(const SafeTensors& weights, const std::string& what) {
    throw Error(ExitCode::bad_input, "weights file " + weights.path().string() + ": " + what);
}

/// Whether prior_busy_pixels() counts any.
bool has_busy_pixel(const PackedEvents& packed) {
    const auto busy = [](uint32_t begin, uint32_t end) { return end - begin > prior_busy_events; };
    return std::ranges::adjacent_find(packed.offset, busy) != packed.offset.end();
}

/// The events of pixels that prior_busy_pixels() does not count; `packed` holds them all.
Events without_busy_pixels(const EventView& events, const PackedEvents& packed, uint32_t width) {
    Events quiet;
    for (size_t i = 0; i < events.size(); ++i) {
        const size_t pixel = size_t{events.y[i]} * width + events.x[i];
        if (packed.offset[pixel + 1] - packed.offset[pixel] <= prior_busy_events) {
            quiet.push_back(events.t[i], events.x[i], events.y[i], events.p[i]);
        }
    }
    return quiet;
}

/// The ranges as the kernel reads them: begin, end, begin, end, ...
std::span<const uint32_t> flat(const std::vector<IntervalRange>& ranges) {
    return {reinterpret_cast<const uint32_t*>(ranges.data()), ranges.size() * 2};
}

} // namespace

EcirConfig::EcirConfig(const SafeTensors& weights)
    : keypoints(weights.meta_count("keypoints", min_keypoints, max_keypoints)),
      bins(weights.meta_count("histogram_bins", 2, kMostBins)),
      iterations(weights.meta_count("iterations", 0, kMostIterations)) {
    const std::string variant = weights.meta("variant");
    if (variant != "paper" && variant != "release") {
        fail(weights, "metadata 'variant' is '" + variant + "'; it must be paper or release");
    }
    release = variant == "release";
    if (bins % 2 != 0) {
        fail(weights, "metadata 'histogram_bins' is odd; every interval has two channels");
    }
    const std::string text = weights.meta("span", "1");
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, span);
    if (error != std::errc{} || stop != end || !(span > 0 && span <= 1)) {
        fail(weights, "metadata 'span' is '" + text + "'; it must lie in (0, 1]");
    }
}

EcirMethod::EcirMethod(std::shared_ptr<Device> device, const SafeTensors& weights, uint32_t height,
                       uint32_t width, const EcirOptions& options)
    : device_(std::move(device)), config_(weights),
      networks_(std::make_shared<const Networks>(
          Networks{UNet(*device_, weights, config_.bins, config_.keypoints,
                        UNet::family(device_->info(), weights, config_.bins, height, width)),
                   Refinement(*device_, weights, !config_.release)})),
      height_(height),
      width_(width), extent_{options.refine.value_or(config_.iterations),
                             options.refine_until.value_or(config_.release ? 0 : kSettled) / 255,
                             options.ordered} {}

EcirMethod::EcirMethod(std::shared_ptr<Device> device, const EcirConfig& config,
                       std::shared_ptr<const Networks> networks, uint32_t height, uint32_t width,
                       const Extent& extent)
    : device_(std::move(device)), config_(config), networks_(std::move(networks)), height_(height),
      width_(width), extent_(extent) {}

std::unique_ptr<Method> EcirMethod::resized(uint32_t height, uint32_t width) const {
    return std::unique_ptr<Method>(
        new EcirMethod(device_, config_, networks_, height, width, extent_));
}

void EcirMethod::record(Program& program, uint32_t frames, uint32_t capacity) {
    const DeviceInfo& info = device_->info();
    const UNet& unet = networks_->unet;
    const uint32_t n = config_.keypoints;
    const bool refine = extent_.iterations > 0;

    events_ = EventTensors(program, height_, width_, capacity);
    blurry_ = program.input(unet.blurry_layout(info, height_, width_));
    rule_ = program.input({1, 1, 4});
    input_intervals_ = program.input({1, 1, config_.bins});
    frame_intervals_ = program.input({1, 1, std::max(2 * (frames - 1), 1U)});
    matrix_ = program.input(curve_matrix_layout(n, frames, extent_.ordered));
    output_ = program.output({frames, height_, width_});

    const Tensor histogram =
        program.cleared(unet.input_layout(info, config_.bins, height_, width_));
    record_event_histogram(program, events_.offset, events_.mark, events_.positives,
                           input_intervals_, histogram);

    const Tensor keypoints = program.cleared(unet.input_layout(info, n, height_, width_));
    record_keypoints(program, events_.offset, events_.time, events_.tick, rule_, keypoints, 0, n);

    const Tensor derivatives = unet.record(program, blurry_, histogram, keypoints);

    CurveOptions curve{.n = n, .spaced = !config_.release};
    if (extent_.ordered) {
        curve.offsets = events_.offset;
    }
    const Tensor initial = refine ? program.cleared({frames, height_, width_, 1, 1}) : output_;
    record_curve(program, derivatives, keypoints, blurry_, matrix_, initial, curve);

    if (refine) {
        Tensor counts;
        if (frames > 1) {
            counts = program.temporary({2 * (frames - 1), height_, width_});
            record_event_histogram(program, events_.offset, events_.mark, events_.positives,
                                   frame_intervals_, counts);
        }
        progress_ =
            networks_->refinement.record(program, initial, counts, output_, extent_.iterations,
                                         config_.iterations, extent_.settled);
    }
}

std::vector<IntervalRange> EcirMethod::intervals(const FrameInput& input,
                                                 std::span<const double> edges) const {
    return config_.release ? release_intervals(input.events, input.exposure, edges)
                           : paper_intervals(input.events, input.exposure, edges);
}

void EcirMethod::begin(const FrameInput& input) {
    const auto count = static_cast<uint32_t>(input.times.size());
    Program& program =
        program_.prepare(*device_, count, input.events.size(),
                         [&](Program& made, uint32_t capacity) { record(made, count, capacity); });
    PackedEvents packed = pack_events(input.events, input.exposure, width_, height_);
    // Counts far over any that it was trained on would reach all of the frame through the U-Net.
    Events quiet;
    FrameInput seen = input;
    if (!config_.release && has_busy_pixel(packed)) {
        quiet = without_busy_pixels(input.events, packed, width_);
        seen.events = quiet.view();
        packed = pack_events(seen.events, seen.exposure, width_, height_);
    }
    const KeypointRule rule = config_.release ? release_keypoint_rule(packed, config_.keypoints)
                                              : paper_keypoint_rule(packed, config_.keypoints);
    if (config_.release) {
        packed.time = release_times(packed);
    }
    events_.write(program, packed);
    std::vector<float> blurry(input.blurry.begin(), input.blurry.end());
    Begun begun{brighten(blurry), {}};
    if (extent_.ordered) {
        begun.orders = curve_orders(packed.offset, width_, height_, config_.keypoints);
    }
    begun_.reserve(begun_.size() + 1); // nothing may fail once the program runs
    program.write(blurry_, from_dense(blurry_.layout(), blurry));
    program.write(rule_, std::span(reinterpret_cast<const uint32_t*>(&rule), 4));
    const uint32_t intervals_count = config_.bins / 2;
    const auto edges = config_.release ? linspace_edges(config_.span, intervals_count)
                                       : even_edges(intervals_count);
    program.write(input_intervals_, flat(intervals(seen, edges)));
    program.write(frame_intervals_, flat(intervals(seen, seen.times)));
    program.write(matrix_, extent_.ordered ? curve_series(config_.keypoints, input.times)
                                           : curve_matrix(config_.keypoints, input.times));
    program_.submit(output_, progress_);
    begun_.push_back(std::move(begun));
}

/// Events tell of ratios, so a scene in less light has the same ones and the same frames but for a
/// factor.
EcirMethod::Brightening EcirMethod::brighten(std::vector<float>& blurry) const {
    std::vector<float> values = blurry;
    const auto percentile = values.begin() + static_cast<std::ptrdiff_t>(values.size() * 99 / 100);
    std::ranges::nth_element(values, percentile);
    if (config_.release || *percentile <= 0 || *percentile >= kBright) {
        return {};
    }
    Brightening made{kBright / *percentile, {}};
    made.cut.reserve(blurry.size());
    for (float& value : blurry) {
        const float bright = std::min(made.gain * value, 1.0F);
        made.cut.push_back(value - bright / made.gain);
        value = bright;
    }
    return made;
}

MethodWork EcirMethod::work() const {
    const auto& progress = program_.figures(); // Refinement::progress_layout()
    const size_t most = progress.size() / 2;
    MethodWork work{.updates = {}, .orders = orders_};
    for (size_t i = 0; i < most && (i == 0 || extent_.settled == 0 || progress[most + i] != 0);
         ++i) {
        work.updates.push_back(progress[i]);
    }
    return work;
}

std::span<const float> EcirMethod::finish() {
    const Begun oldest = std::move(begun_.at(0));
    begun_.erase(begun_.begin());
    const Brightening& made = oldest.brightening;
    orders_ = oldest.orders;
    const auto frames = program_.finish();
    if (made.gain == 1) {
        return frames;
    }
    darkened_.assign(frames.begin(), frames.end());
    for (size_t i = 0; i < darkened_.size(); ++i) {
        darkened_[i] = darkened_[i] / made.gain + made.cut[i % made.cut.size()];
    }
    return darkened_;
}

} // namespace ecir
