#include "layers/fusion.hpp"

#include <algorithm>

#include "layers/consistency.hpp"
#include "layers/conv.hpp"
#include "layers/elementwise.hpp"
#include "layers/fusion_fetch.hpp"
#include "layers/motion.hpp"
#include "layers/shapes.hpp"
#include "layers/trajectory.hpp"

namespace ecir {

/// What an exposure's frames are corrected with.
struct FusionMethod::Correction {
    /// Of a frame, and after it of others.
    struct Desk {
        FusionHead::Tensors head;
        Tensor away;
        Tensor alone;
        Tensor differences;
    };
    PriorInput input;
    PriorExposure exposure;
    Tensor moved;
    Tensor features;
    const FusionHead* network = nullptr;
    std::vector<Desk> desks; ///< frames take them in turn
    Tensor consistency;

    [[nodiscard]] const Desk& desk(uint32_t frame) const { return desks[frame % desks.size()]; }
    /// The head's first input, the prior, and where things are at the anchors.
    void record_time(Program& program, const Desk& desk, const Tensor& instant,
                     const Tensor& state) const {
        record_prior_frame(program, input, exposure.base, instant, state, desk.head.planes);
        record_trajectory(program, moved, instant, desk.away);
    }
    /// After record_time().
    void record_frame(Program& program, const Desk& desk, const Tensor& instant,
                      const Tensor& frame) const {
        record_fusion_fetch(program, exposure.anchors, desk.away, instant, desk.head.planes);
        record_fusion_mix(program, features, instant, desk.head.mixed);
        network->record(program, desk.head, frame);
    }
};

std::shared_ptr<const FusionMethod::Networks> FusionMethod::load(Device& device,
                                                                 const SafeTensors& weights) {
    const FusionWidths widths(weights);
    return std::make_shared<const Networks>(
        Networks{FusionTrunk(device, weights, widths), FusionHead(device, weights, widths)});
}

FusionMethod::FusionMethod(const std::shared_ptr<Device>& device, const SafeTensors& weights,
                           uint32_t height, uint32_t width, FusionSteps steps)
    : FusionMethod(device, load(*device, weights), height, width, steps) {}

FusionMethod::FusionMethod(std::shared_ptr<Device> device, std::shared_ptr<const Networks> networks,
                           uint32_t height, uint32_t width, FusionSteps steps)
    : device_(std::move(device)), networks_(std::move(networks)), height_(height), width_(width),
      steps_(steps) {}

std::unique_ptr<Method> FusionMethod::resized(uint32_t height, uint32_t width) const {
    return std::unique_ptr<Method>(new FusionMethod(device_, networks_, height, width, steps_));
}

FusionMethod::Shared FusionMethod::find_shared(std::span<const double> times) {
    Shared shared;
    for (uint32_t i = 0; i < reference_count; ++i) {
        const auto at = std::ranges::find(times, reference_times.at(i));
        if (at != times.end()) {
            shared.at(i) = static_cast<uint32_t>(at - times.begin());
        }
    }
    return shared;
}

void FusionMethod::record(Program& program, uint32_t frames, const Shared& shared,
                          uint32_t capacity) {
    events_ = EventTensors(program, height_, width_, capacity);
    blurry_ = program.input({1, height_, width_});
    threshold_input_ = program.input({1, 1, 2});
    const bool agreed = steps_ == FusionSteps::agreed;
    instants_ = program.input(instant_layout(frames + (agreed ? reference_count : 0)));
    output_ = program.output({frames, height_, width_});
    const PriorInput input{events_.offset,    events_.time, events_.mark,
                           events_.positives, blurry_,      threshold_input_};

    PriorExposure exposure;
    const Layout images = networks_->trunk.exposure_layout(device_->info(), height_, width_);
    exposure.anchors = program.cleared(images);
    exposure.context = program.cleared(images);
    exposure.base = program.temporary({1, height_, width_});
    exposure.logarithms =
        program.temporary({prior_windows + 1, (height_ + 1) / 2, (width_ + 1) / 2});
    record_prior(program, input, exposure);
    if (steps_ == FusionSteps::prior) {
        record_prior_frames(program, input, exposure);
        return;
    }
    const Correction correction = record_correction(program, input, exposure);
    if (agreed) {
        record_agreed_frames(program, correction, shared);
    } else {
        record_corrected_frames(program, correction);
    }
}

FusionMethod::Correction FusionMethod::record_correction(Program& program, const PriorInput& input,
                                                         const PriorExposure& exposure) const {
    const Tensor moved = program.temporary(motion_layout(height_, width_));
    const Tensor velocity =
        program.cleared(networks_->trunk.velocity_layout(device_->info(), height_, width_));
    record_motion(program, exposure.logarithms, moved, velocity);
    std::vector<Correction::Desk> desks;
    const uint32_t frames = instants_.layout().channels;
    for (uint32_t i = 0; i < std::min(images_at_once(device_->info(), height_, width_), frames);
         ++i) {
        desks.push_back({networks_->head.prepare(program, height_, width_),
                         program.temporary(away_layout(height_, width_)),
                         program.temporary({1, height_, width_}),
                         program.temporary({reference_count, height_, width_})});
    }
    return {.input = input,
            .exposure = exposure,
            .moved = moved,
            .features = networks_->trunk.record(program, exposure, velocity),
            .network = &networks_->head,
            .desks = std::move(desks),
            .consistency = program.cleared(consistency_state_layout(height_, width_))};
}

void FusionMethod::record_corrected_frames(Program& program, const Correction& correction) const {
    const Tensor state = program.cleared(prior_state_layout(height_, width_));
    for (uint32_t i = 0; i < output_.layout().channels; ++i) {
        const Tensor instant = instants_.channels(i, 1);
        const Correction::Desk& desk = correction.desk(i);
        correction.record_time(program, desk, instant, state);
        correction.record_frame(program, desk, instant, output_.channels(i, 1));
        record_kept(program, correction, desk.head.planes.channels(0, 1), i);
    }
    record_consistent(program, correction.consistency, output_);
}

void FusionMethod::record_agreed_frames(Program& program, const Correction& correction,
                                        const Shared& shared) const {
    const Tensor references = program.temporary({reference_count, height_, width_});
    const uint32_t frames = output_.layout().channels;
    const Tensor before = program.cleared(prior_state_layout(height_, width_));
    for (uint32_t i = 0; i < reference_count; ++i) {
        const Tensor instant = instants_.channels(frames + i, 1);
        const Correction::Desk& desk = correction.desk(i);
        correction.record_time(program, desk, instant, before);
        correction.record_frame(program, desk, instant, references.channels(i, 1));
    }
    // One of its own, since the times begin anew.
    const Tensor state = program.cleared(prior_state_layout(height_, width_));
    for (uint32_t i = 0; i < frames; ++i) {
        const Tensor instant = instants_.channels(i, 1);
        const Correction::Desk& desk = correction.desk(reference_count + i);
        correction.record_time(program, desk, instant, state);
        const auto same = std::ranges::find(shared, std::optional(i));
        Tensor own = desk.alone;
        if (same != shared.end()) {
            own = references.channels(static_cast<uint32_t>(same - shared.begin()), 1);
        } else {
            correction.record_frame(program, desk, instant, own);
        }
        record_reference_fetch(program, references, desk.away, instant, own, desk.differences);
        record_agreement(program, desk.differences, own, output_.channels(i, 1));
        record_kept(program, correction, desk.head.planes.channels(0, 1), i);
    }
    record_consistent(program, correction.consistency, output_);
}

void FusionMethod::record_kept(Program& program, const Correction& correction, const Tensor& prior,
                               uint32_t frame) const {
    record_consistency(program, output_.channels(frame, 1), prior, blurry_,
                       instants_.channels(frame, 1), correction.consistency,
                       frame + 1 == output_.layout().channels);
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
    const Shared shared = find_shared(input.times);
    if (steps_ == FusionSteps::agreed && shared != shared_) {
        program_.outdate();
        shared_ = shared;
    }
    Program& program = program_.prepare(
        *device_, count, input.events.size(),
        [&](Program& made, uint32_t capacity) { record(made, count, shared, capacity); });
    const PackedEvents packed = pack_events(input.events, input.exposure, width_, height_);
    events_.write(program, packed);
    program.write(blurry_, input.blurry);
    program.write(threshold_input_, std::as_bytes(std::span(&input.thresholds, 1)));
    auto instants = make_instants(input.times);
    if (steps_ == FusionSteps::agreed) {
        for (const double time : reference_times) {
            instants.emplace_back(time);
        }
    }
    program.write(instants_, std::as_bytes(std::span(instants)));
    program_.submit(output_);
}

} // namespace ecir
