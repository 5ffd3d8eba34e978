#include "tools/stability/stages.hpp"

#include <algorithm>
#include <cmath>

#include "layers/curve.hpp"
#include "layers/elementwise.hpp"
#include "layers/event_pack.hpp"
#include "layers/keypoints.hpp"
#include "layers/operations.hpp"

namespace ecir::stability {
namespace {

constexpr float kLargestHalf = 65520; ///< from here on the nearest float16 is infinity

void round_all(std::vector<float>& values) {
    std::ranges::transform(values, values.begin(), rounded_to_half);
}

/// A program's input with these dense values once it runs.
struct Inputs {
    Program& program;
    std::vector<std::pair<Tensor, std::vector<float>>> given;
    Tensor operator()(const Layout& layout, const std::vector<float>& dense) {
        const Tensor tensor = program.input(layout);
        given.emplace_back(tensor, from_dense(layout, dense));
        return tensor;
    }
    void run() {
        program.finish();
        for (const auto& [tensor, memory] : given) {
            program.write(tensor, memory);
        }
        program.run();
    }
};

std::vector<float> dense(const Program& program, const Tensor& output) {
    return to_dense(output.layout(), program.read(output));
}

std::span<const uint32_t> flat(const std::vector<IntervalRange>& ranges) {
    return {reinterpret_cast<const uint32_t*>(ranges.data()), ranges.size() * 2};
}

/// What is counted and chosen of the events.
struct EventFields {
    std::vector<float> histogram; ///< bins x height x width
    std::vector<float> keypoints; ///< n x height x width
    std::vector<float> counts;    ///< 2 (frames - 1) x height x width
};

EventFields event_fields(Device& device, const EcirConfig& config, const FrameInput& input,
                         uint32_t width, uint32_t height) {
    const PackedEvents packed = pack_events(input.events, input.exposure, width, height);
    const auto bins = paper_intervals(input.events, input.exposure, even_edges(config.bins / 2));
    const auto between = paper_intervals(input.events, input.exposure, input.times);
    const auto frames = static_cast<uint32_t>(input.times.size());
    const KeypointRule rule = paper_keypoint_rule(packed, config.keypoints);

    Program program(device);
    const EventTensors events(program, height, width, EventTensors::capacity_for(packed.size()));
    const Tensor rule_input = program.input({1, 1, 4});
    const Tensor bin_input = program.input({1, 1, config.bins});
    const Tensor between_input = program.input({1, 1, 2 * (frames - 1)});
    const Tensor histogram = program.output({config.bins, height, width});
    const Tensor keypoints = program.output({config.keypoints, height, width});
    const Tensor counts = program.output({2 * (frames - 1), height, width});
    record_event_histogram(program, events.offset, events.mark, events.positives, bin_input,
                           histogram);
    record_event_histogram(program, events.offset, events.mark, events.positives, between_input,
                           counts);
    record_keypoints(program, events.offset, events.time, events.tick, rule_input, keypoints, 0,
                     config.keypoints);
    program.finish();
    events.write(program, packed);
    program.write(rule_input, std::span(reinterpret_cast<const uint32_t*>(&rule), 4));
    program.write(bin_input, flat(bins));
    program.write(between_input, flat(between));
    program.run();
    return {dense(program, histogram), dense(program, keypoints), dense(program, counts)};
}

} // namespace

float rounded_to_half(float value) {
    if (value == 0 || !std::isfinite(value)) {
        return value;
    }
    if (std::abs(value) >= kLargestHalf) {
        return std::copysign(INFINITY, value);
    }
    // 11 significant bits, fewer below 2^-14.
    const float step = std::ldexp(1.0F, std::max(std::ilogb(value), -14) - 10);
    return std::nearbyint(value / step) * step;
}

StagedEcir::StagedEcir(Device& device, const SafeTensors& weights, uint32_t width, uint32_t height)
    : device_(device), config_(weights), width_(width), height_(height),
      unet_(device, weights, config_.bins, config_.keypoints,
            UNet::family(device.info(), weights, config_.bins, height, width)),
      refinement_(device, weights, !config_.release) {}

StagedFrames StagedEcir::frames(const FrameInput& input, Border border) {
    const uint32_t width = width_;
    const uint32_t height = height_;
    const uint32_t n = config_.keypoints;
    const auto count = static_cast<uint32_t>(input.times.size());
    const auto crossing = [&](Border at, std::vector<float> values) {
        if (at == border) {
            round_all(values);
        }
        return values;
    };
    const EventFields fields = event_fields(device_, config_, input, width, height);
    const auto blurry =
        crossing(Border::blurry, std::vector<float>(input.blurry.begin(), input.blurry.end()));

    Program network(device_);
    Inputs network_inputs{network, {}};
    const DeviceInfo& info = device_.info();
    const Layout wide = unet_.input_layout(info, config_.bins, height, width);
    const Layout points = unet_.input_layout(info, n, height, width);
    const Tensor slopes =
        unet_.record(network, network_inputs(unet_.blurry_layout(info, height, width), blurry),
                     network_inputs(wide, crossing(Border::histogram, fields.histogram)),
                     network_inputs(points, crossing(Border::network, fields.keypoints)));
    const Tensor slopes_output = network.output(slopes.layout());
    const Tensor nothing =
        network_inputs(slopes.layout(), std::vector<float>(size_t{n} * height * width, 0.0F));
    record_add(network, slopes, nothing, slopes_output);
    network_inputs.run();
    const auto derivatives = crossing(Border::derivatives, dense(network, slopes_output));

    Program curve(device_);
    Inputs curve_inputs{curve, {}};
    const Layout plain{n, height, width};
    const Tensor curve_frames = curve.output({count, height, width});
    record_curve(curve, curve_inputs(plain, derivatives),
                 curve_inputs(plain, crossing(Border::keypoints, fields.keypoints)),
                 curve_inputs({1, height, width}, blurry),
                 curve_inputs(curve_matrix_layout(n, count),
                              crossing(Border::matrix, curve_matrix(n, input.times))),
                 curve_frames, {.n = n, .spaced = !config_.release});
    curve_inputs.run();
    StagedFrames result;
    result.curve = crossing(Border::initial, dense(curve, curve_frames));

    Program refining(device_);
    Inputs refining_inputs{refining, {}};
    const Tensor refined = refining.output({count, height, width});
    refinement_.record(refining, refining_inputs({count, height, width, 1, 1}, result.curve),
                       refining_inputs({2 * (count - 1), height, width}, fields.counts), refined,
                       config_.iterations, config_.iterations, 0);
    refining_inputs.run();
    result.refined = crossing(Border::refined, dense(refining, refined));
    return result;
}

std::vector<float> staged_edi(const FrameInput& input, uint32_t width, uint32_t height,
                              const EdiThresholds& thresholds, EdiBorder border) {
    constexpr float offset = 0.01F;
    const PackedEvents packed = pack_events(input.events, input.exposure, width, height);
    const size_t pixels = size_t{width} * height;
    const auto kept = [&](EdiBorder at, float value) {
        return at == border ? rounded_to_half(value) : value;
    };
    std::vector<float> frames(input.times.size() * pixels);
    for (size_t p = 0; p < pixels; ++p) {
        float sum = 0;
        float integral = 0;
        float before = -1;
        size_t next = 0; // the next frame to fill
        const auto reach = [&](float time) {
            for (; next < input.times.size() && static_cast<float>(input.times[next]) < time;
                 ++next) {
                frames[next * pixels + p] = std::exp(sum);
            }
            integral = kept(EdiBorder::integral, integral + (time - before) / 2 * std::exp(sum));
            before = time;
        };
        for (uint32_t i = packed.offset[p]; i < packed.offset[p + 1]; ++i) {
            reach(kept(EdiBorder::times, packed.time[i]));
            const bool brighter = packed.mark[i] >> 31 != 0;
            sum =
                kept(EdiBorder::sum, sum + (brighter ? thresholds.positive : -thresholds.negative));
        }
        reach(1);
        for (; next < input.times.size(); ++next) {
            frames[next * pixels + p] = std::exp(sum);
        }
        for (size_t f = 0; f < input.times.size(); ++f) {
            float& value = frames[f * pixels + p];
            value = (input.blurry[p] + offset) * value / integral - offset;
        }
    }
    return frames;
}

} // namespace ecir::stability
