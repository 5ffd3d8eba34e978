#include "layers/edi_method.hpp"

namespace ecir {
namespace {

constexpr uint32_t kSmallestEstimate = 16; ///< pixels a side that the estimation needs

} // namespace

EdiMethod::EdiMethod(std::shared_ptr<Device> device, uint32_t height, uint32_t width,
                     std::optional<EdiThresholds> thresholds)
    : device_(std::move(device)), height_(height), width_(width), given_(thresholds) {
    if (!given_ && std::min(width, height) < kSmallestEstimate) {
        given_ = EdiThresholds{};
    }
    if (!given_) {
        estimator_ = std::make_unique<EdiThresholdEstimator>(*device_, width, height);
    }
}

void EdiMethod::build(uint32_t frames, uint32_t capacity) {
    program_ = std::make_unique<Program>(*device_);
    events_ = EventTensors(*program_, height_, width_, capacity);
    blurry_ = program_->input({1, height_, width_});
    thresholds_ = program_->input({1, 1, 2});
    schedule_ = program_->input({1, 2, frames});
    busy_ = program_->input({1, 1, edi_busy_length(capacity)});
    output_ = program_->output({frames, height_, width_});
    record_edi(*program_, {events_.offset, events_.time, events_.mark, blurry_, thresholds_},
               schedule_, busy_, output_);
    program_->finish();
    count_ = frames;
}

std::span<const float> EdiMethod::frames(const FrameInput& input) {
    const auto count = static_cast<uint32_t>(input.times.size());
    if (!program_ || count != count_ || input.events.size() > events_.capacity) {
        build(count, EventTensors::capacity_for(input.events.size()));
    }
    const PackedEvents packed = pack_events(input.events, input.exposure, width_, height_);
    used_ = given_ ? *given_ : estimator_->estimate(packed, input.blurry);
    events_.write(*program_, packed);
    program_->write(blurry_, input.blurry);
    program_->write(thresholds_, std::span<const float>(&used_->positive, 2));
    program_->write(schedule_, edi_schedule(input.times));
    program_->write(busy_, edi_busy_pixels(packed));
    program_->run();
    return program_->read(output_);
}

} // namespace ecir
