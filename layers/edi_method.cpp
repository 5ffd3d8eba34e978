#include "layers/edi_method.hpp"

namespace ecir {
EdiMethod::EdiMethod(std::shared_ptr<Device> device, uint32_t height, uint32_t width,
                     std::optional<EdiThresholds> thresholds)
    : device_(std::move(device)), height_(height), width_(width),
      source_(*device_, width, height, thresholds) {}

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
    const EdiThresholds thresholds = source_.choose(packed, input.blurry);
    events_.write(*program_, packed);
    program_->write(blurry_, input.blurry);
    program_->write(thresholds_, std::span<const float>(&thresholds.positive, 2));
    program_->write(schedule_, edi_schedule(input.times));
    program_->write(busy_, edi_busy_pixels(packed));
    program_->run();
    return program_->read(output_);
}

} // namespace ecir
