#pragma once
#include <bit>
#include <optional>
#include <span>
#include <vector>

#include "layers/edi.hpp"
#include "layers/event_pack.hpp"
#include "runtime/program.hpp"

namespace ecir {

/// One blurry frame with what was seen during its exposure.
struct FrameInput {
    std::span<const float> blurry; ///< height x width, 0 ... 1
    EventView events;              ///< of the exposure, sorted by time
    Exposure exposure;
    std::span<const double> times; ///< wanted, normalised, ascending
};

/// A way from a blurry frame and its events to sharp frames, for one image size on one device.
class Method {
public:
    Method() = default;
    virtual ~Method() = default;
    Method(const Method&) = delete;
    Method& operator=(const Method&) = delete;

    /// times x height x width, in the order of the times; valid until the next call. Not clipped.
    virtual std::span<const float> frames(const FrameInput& input) = 0;

    /// The contrast thresholds used for the last frame, where the method has such.
    [[nodiscard]] virtual std::optional<EdiThresholds> thresholds() const { return std::nullopt; }
};

/// Inputs of a program that hold PackedEvents, for up to `capacity` of them.
struct EventTensors {
    Tensor offset;
    Tensor time;
    Tensor mark;
    Tensor tick;
    Tensor positives;
    uint32_t capacity = 0;

    EventTensors() = default;
    EventTensors(Program& program, uint32_t height, uint32_t width, uint32_t events)
        : offset(program.input({1, 1, height * width + 1})), time(program.input({1, 1, events})),
          mark(program.input({1, 1, events})), tick(program.input({1, 1, events})),
          positives(program.input({1, 1, events + 1})), capacity(events) {}

    void write(Program& program, const PackedEvents& events) const {
        program.write(offset, events.offset);
        program.write(time, events.time);
        program.write(mark, events.mark);
        program.write(tick, events.tick);
        program.write(positives, events.positives);
    }

    /// A capacity for `events` that grows in powers of two, so that programs are rarely made anew.
    static uint32_t capacity_for(size_t events) {
        constexpr uint32_t kLeast = 1U << 14;
        return std::max(kLeast, std::bit_ceil(static_cast<uint32_t>(events)));
    }
};

} // namespace ecir
