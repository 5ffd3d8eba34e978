#pragma once
#include <bit>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "layers/edi.hpp"
#include "layers/event_pack.hpp"
#include "runtime/error.hpp"
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

    /// Pixels of the last frame with so many events that the method took them as without.
    [[nodiscard]] virtual size_t ignored_pixels() const { return 0; }
};

/// Inputs of a program that hold PackedEvents, for up to `capacity` of them.
struct EventTensors {
    Tensor offset;
    Tensor time;
    Tensor mark;
    Tensor tick;
    Tensor positives;

    EventTensors() = default;
    EventTensors(Program& program, uint32_t height, uint32_t width, uint32_t events)
        : offset(program.input({1, 1, height * width + 1})), time(program.input({1, 1, events})),
          mark(program.input({1, 1, events})), tick(program.input({1, 1, events})),
          positives(program.input({1, 1, events + 1})) {}

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

/// A method's program, recorded anew when the number of frames changes or more events come than it
/// has room for.
class MethodProgram {
public:
    /// Calls record(program, capacity), which makes the tensors and adds the steps, where a new
    /// program is needed. Whatever that or finish() throws, the next call records again.
    template <typename Record>
    Program& prepare(Device& device, size_t frames, size_t events, const Record& record) {
        if (!program_ || frames != frames_ || events > capacity_) {
            program_.reset(); // what it holds must be free before the next one asks for as much
            frames_ = frames;
            capacity_ = EventTensors::capacity_for(events);
            auto made = std::make_unique<Program>(device);
            record(*made, capacity_);
            made->finish();
            program_ = std::move(made);
        }
        return *program_;
    }

    /// Time of each dispatch of a run with the last input. Throws Error(device) before the first
    /// one, and where the device has no timestamps.
    [[nodiscard]] std::vector<DispatchTime> profile() const {
        if (!program_) {
            throw Error(ExitCode::device, "profile: no frame has been made yet");
        }
        return program_->profile();
    }

private:
    std::unique_ptr<Program> program_;
    size_t frames_ = 0;
    uint32_t capacity_ = 0; ///< events
};

} // namespace ecir
