#include "layers/edi_method.hpp"

namespace ecir {

EdiMethod::EdiMethod(std::shared_ptr<Device> device, uint32_t height, uint32_t width)
    : device_(std::move(device)), height_(height), width_(width) {}

std::unique_ptr<Method> EdiMethod::resized(uint32_t height, uint32_t width) const {
    return std::make_unique<EdiMethod>(device_, height, width);
}

void EdiMethod::record(Program& program, uint32_t frames, uint32_t capacity) {
    events_ = EventTensors(program, height_, width_, capacity);
    blurry_ = program.input({1, height_, width_});
    thresholds_ = program.input({1, 1, 2});
    schedule_ = program.input({1, 2, frames});
    busy_ = program.input({1, 1, edi_busy_length(capacity)});
    output_ = program.output({frames, height_, width_});
    record_edi(program, {events_.offset, events_.time, events_.mark, blurry_, thresholds_},
               schedule_, busy_, output_);
}

void EdiMethod::begin(const FrameInput& input) {
    const auto count = static_cast<uint32_t>(input.times.size());
    Program& program =
        program_.prepare(*device_, count, input.events.size(),
                         [&](Program& made, uint32_t capacity) { record(made, count, capacity); });
    const PackedEvents packed = pack_events(input.events, input.exposure, width_, height_);
    events_.write(program, packed);
    program.write(blurry_, input.blurry);
    program.write(thresholds_, std::as_bytes(std::span(&input.thresholds, 1)));
    program.write(schedule_, edi_schedule(input.times));
    program.write(busy_, edi_busy_pixels(packed));
    program_.submit(output_);
}

} // namespace ecir
