#include "layers/fusion.hpp"

#include "layers/elementwise.hpp"
#include "layers/fusion_fetch.hpp"
#include "layers/motion.hpp"
#include "layers/trajectory.hpp"

namespace ecir {

namespace {

constexpr char kCoarse[] = "coarse_";

} // namespace

std::shared_ptr<const FusionMethod::Networks> FusionMethod::load(Device& device,
                                                                 const SafeTensors& weights) {
    std::vector<FusionWidths> widths{FusionWidths(weights)};
    const bool coarse = weights.metadata().contains(std::string(kCoarse) + "trunk");
    if (coarse) {
        widths.emplace_back(weights, kCoarse);
    }
    const ConvFamily family = fusion_family(device.info(), widths);
    const auto network = [&](const std::string& prefix, const FusionWidths& of) {
        return Network{FusionTrunk(device, weights, prefix, of, family),
                       FusionHead(device, weights, prefix, of, family)};
    };
    auto networks = std::make_shared<Networks>(Networks{{}, network("fusion.", widths.front())});
    if (coarse) {
        networks->coarse.emplace(network("fusion.coarse.", widths.back()));
    }
    return networks;
}

FusionMethod::FusionMethod(std::shared_ptr<Device> device, const SafeTensors& weights,
                           uint32_t height, uint32_t width, bool correct)
    : FusionMethod(device, load(*device, weights), height, width, correct) {}

FusionMethod::FusionMethod(std::shared_ptr<Device> device, std::shared_ptr<const Networks> networks,
                           uint32_t height, uint32_t width, bool correct)
    : device_(std::move(device)), networks_(std::move(networks)), height_(height), width_(width),
      correct_(correct) {}

std::unique_ptr<Method> FusionMethod::resized(uint32_t height, uint32_t width) const {
    return std::unique_ptr<Method>(new FusionMethod(device_, networks_, height, width, correct_));
}

void FusionMethod::record(Program& program, uint32_t frames, uint32_t capacity) {
    const bool coarse = correct_ && networks_->coarse;
    const FusionTrunk& trunk = networks_->fine.trunk;
    events_ = EventTensors(program, height_, width_, capacity);
    blurry_ = program.input({1, height_, width_});
    threshold_input_ = program.input({1, 1, 2});
    instants_ = program.input(instant_layout(frames + (coarse ? anchor_count : 0)));
    output_ = program.output({frames, height_, width_});
    Recorded recorded;
    recorded.input = {events_.offset,    events_.time, events_.mark,
                      events_.positives, blurry_,      threshold_input_};

    PriorExposure& exposure = recorded.exposure;
    const Layout images = trunk.exposure_layout(device_->info(), height_, width_);
    exposure.anchors = cleared(program, images);
    exposure.context = cleared(program, images);
    exposure.base = program.temporary({1, height_, width_});
    exposure.logarithms =
        program.temporary({prior_windows + 1, (height_ + 1) / 2, (width_ + 1) / 2});
    record_prior(program, recorded.input, exposure);
    if (!correct_) {
        record_prior_frames(program, recorded.input, exposure);
        return;
    }
    recorded.moved = program.temporary(motion_layout(height_, width_));
    recorded.velocity_channels =
        cleared(program, trunk.velocity_layout(device_->info(), height_, width_));
    record_motion(program, exposure.logarithms, recorded.moved, recorded.velocity_channels);
    if (coarse) {
        const Tensor sharp = cleared(program, images);
        record_corrected_frames(program, *networks_->coarse, recorded,
                                instants_.channels(frames, anchor_count), sharp);
        exposure.anchors = sharp;
    }
    record_corrected_frames(program, networks_->fine, recorded, instants_.channels(0, frames),
                            output_);
}

void FusionMethod::record_corrected_frames(Program& program, const Network& network,
                                           const Recorded& recorded, const Tensor& instants,
                                           const Tensor& frames) const {
    const auto& [input, exposure, moved, velocity_channels] = recorded;
    const Tensor features = network.trunk.record(program, exposure, velocity_channels);
    const FusionHead::Tensors head = network.head.prepare(program, height_, width_);
    const Tensor away = program.temporary(away_layout(height_, width_));
    const Tensor state = cleared(program, prior_state_layout(height_, width_));
    for (uint32_t i = 0; i < frames.layout().channels; ++i) {
        const Tensor instant = instants.channels(i, 1);
        record_prior_frame(program, input, exposure.base, instant, state, head.planes);
        record_trajectory(program, moved, instant, away);
        record_fusion_fetch(program, exposure.anchors, away, instant, head.planes);
        record_fusion_mix(program, features, instant, head.mixed);
        network.head.record(program, head, frames.channels(i, 1));
    }
}

void FusionMethod::record_prior_frames(Program& program, const PriorInput& input,
                                       const PriorExposure& exposure) const {
    const Tensor planes = program.temporary({plane_count, height_, width_});
    const Tensor nothing = cleared(program, {1, height_, width_});
    const Tensor state = cleared(program, prior_state_layout(height_, width_));
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
    std::vector<double> times(input.times.begin(), input.times.end());
    if (instants_.layout().channels > count) { // the coarse network has frames there
        const auto anchors = anchor_times();
        times.insert(times.end(), anchors.begin(), anchors.end());
    }
    const auto instants = make_instants(times);
    program.write(instants_, std::as_bytes(std::span(instants)));
    program_.submit(output_);
}

} // namespace ecir
