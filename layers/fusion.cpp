#include "layers/fusion.hpp"

#include "layers/consistency.hpp"
#include "layers/elementwise.hpp"
#include "layers/fusion_fetch.hpp"
#include "layers/motion.hpp"
#include "layers/shapes.hpp"
#include "layers/trajectory.hpp"

namespace ecir {

std::shared_ptr<const FusionMethod::Networks> FusionMethod::load(Device& device,
                                                                 const SafeTensors& weights) {
    const FusionWidths widths(weights);
    return std::make_shared<const Networks>(
        Networks{FusionTrunk(device, weights, widths), FusionHead(device, weights, widths)});
}

FusionMethod::FusionMethod(const std::shared_ptr<Device>& device, const SafeTensors& weights,
                           uint32_t height, uint32_t width, bool correct)
    : FusionMethod(device, load(*device, weights), height, width, width, correct) {}

FusionMethod::FusionMethod(std::shared_ptr<Device> device, std::shared_ptr<const Networks> networks,
                           uint32_t height, uint32_t width, uint32_t row, bool correct)
    : device_(std::move(device)), networks_(std::move(networks)), height_(height), width_(width),
      row_(row), correct_(correct) {}

std::unique_ptr<Method> FusionMethod::resized(uint32_t height, uint32_t width) const {
    return std::unique_ptr<Method>(
        new FusionMethod(device_, networks_, height, width, window_row(width, row_), correct_));
}

void FusionMethod::record(Program& program, uint32_t frames, uint32_t capacity) {
    events_ = EventTensors(program, height_, width_, capacity);
    blurry_ = program.input({1, height_, width_});
    threshold_input_ = program.input({1, 1, 2});
    instants_ = program.input(instant_layout(frames));
    output_ = program.output({frames, height_, width_});
    const PriorInput input{events_.offset,    events_.time, events_.mark,
                           events_.positives, blurry_,      threshold_input_};

    PriorExposure exposure;
    const Layout images = networks_->trunk.exposure_layout(device_->info(), height_, width_, row_);
    exposure.anchors = program.cleared(images);
    exposure.context = program.cleared(images);
    exposure.base = program.temporary({1, height_, width_});
    exposure.logarithms =
        program.temporary({prior_windows + 1, (height_ + 1) / 2, (width_ + 1) / 2});
    record_prior(program, input, exposure);
    if (correct_) {
        record_corrected_frames(program, input, exposure);
    } else {
        record_prior_frames(program, input, exposure);
    }
}

void FusionMethod::record_corrected_frames(Program& program, const PriorInput& input,
                                           const PriorExposure& exposure) const {
    const Tensor moved = program.temporary(motion_layout(height_, width_));
    const Tensor velocity =
        program.cleared(networks_->trunk.velocity_layout(device_->info(), height_, width_, row_));
    record_motion(program, exposure.logarithms, moved, velocity);
    const Tensor features = networks_->trunk.record(program, exposure, velocity, row_);

    const FusionHead::Tensors head = networks_->head.prepare(program, height_, width_, row_);
    const Tensor away = program.temporary(away_layout(height_, width_));
    const Tensor state = program.cleared(prior_state_layout(height_, width_));
    const Tensor consistency = program.cleared(consistency_state_layout(height_, width_));
    const uint32_t frames = output_.layout().channels;
    for (uint32_t i = 0; i < frames; ++i) {
        const Tensor instant = instants_.channels(i, 1);
        const Tensor frame = output_.channels(i, 1);
        record_prior_frame(program, input, exposure.base, instant, state, head.planes);
        record_trajectory(program, moved, instant, away);
        record_fusion_fetch(program, exposure.anchors, away, instant, head.planes);
        record_fusion_mix(program, features, instant, head.mixed);
        networks_->head.record(program, head, frame);
        record_consistency(program, frame, head.planes.channels(0, 1), blurry_, instant,
                           consistency, i + 1 == frames);
    }
    record_consistent(program, consistency, output_);
}

void FusionMethod::record_prior_frames(Program& program, const PriorInput& input,
                                       const PriorExposure& exposure) const {
    const Tensor planes = program.temporary({plane_count, height_, width_});
    const Tensor nothing = program.cleared({1, height_, width_});
    const Tensor state = program.cleared(prior_state_layout(height_, width_));
    for (uint32_t i = 0; i < output_.layout().channels; ++i) {
        record_prior_frame(program, input, exposure.base, instants_.channels(i, 1), state, planes);
        record_add(program, planes.channels(0, 1), nothing, output_.channels(i, 1));
    }
}

void FusionMethod::begin(const FrameInput& input) {
    const auto count = static_cast<uint32_t>(input.times.size());
    Program& program =
        program_.prepare(*device_, count, input.events.size(),
                         [&](Program& made, uint32_t capacity) { record(made, count, capacity); });
    const PackedEvents packed = pack_events(input.events, input.exposure, width_, height_);
    events_.write(program, packed);
    program.write(blurry_, input.blurry);
    program.write(threshold_input_, std::as_bytes(std::span(&input.thresholds, 1)));
    const auto instants = make_instants(input.times);
    program.write(instants_, std::as_bytes(std::span(instants)));
    program_.submit(output_);
}

} // namespace ecir
