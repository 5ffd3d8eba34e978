#pragma once
#include <algorithm>
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
    EdiThresholds thresholds{};    ///< of the sensor; for methods that use them
};

/// What a method found that a frame needs.
struct MethodWork {
    /// Of a refinement: the largest change of a pixel in each iteration made, 0 to 1.
    std::vector<float> updates;
    /// Of a curve whose order follows the events: pixels of order 0, 1, ...
    std::vector<size_t> orders;
};

/// A way from a blurry frame and its events to sharp frames, for one image size on one device. In
/// two halves, so that the host can prepare a frame while the device works on the one before.
class Method {
public:
    Method() = default;
    virtual ~Method() = default;
    Method(const Method&) = delete;
    Method& operator=(const Method&) = delete;

    /// Starts on a frame; nothing of the input is needed afterwards. Where it throws nothing was
    /// started.
    virtual void begin(const FrameInput& input) = 0;

    /// Of the oldest frame begun and not finished: times x height x width, in the order of the
    /// times; valid until the next call. Not clipped.
    virtual std::span<const float> finish() = 0;

    /// Of the frame finished last.
    [[nodiscard]] virtual MethodWork work() const { return {}; }

    /// Floating-point operations of the program that makes the frames, at the most; 0 before the
    /// first.
    [[nodiscard]] virtual double operations() const = 0;

    /// The same method for images of another size, with the same weights on the device.
    [[nodiscard]] virtual std::unique_ptr<Method> resized(uint32_t height,
                                                          uint32_t width) const = 0;

    /// Both halves, with nothing begun before.
    std::span<const float> frames(const FrameInput& input) {
        begin(input);
        return finish();
    }
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
/// has room for. Two runs of it can be under way.
class MethodProgram {
public:
    /// A program whose inputs can be written. Calls record(program, capacity), which makes the
    /// tensors and adds the steps, where a new program is needed. Whatever that or its finish()
    /// throws, the next call records again.
    template <typename Record>
    Program& prepare(Device& device, size_t frames, size_t events, const Record& record) {
        if (!program_ || frames_ != frames || events > capacity_) {
            while (set_aside_oldest()) {
            }
            program_.reset(); // what it holds must be free before the next one asks for as much
            frames_ = frames;
            capacity_ = EventTensors::capacity_for(events);
            auto made = std::make_unique<Program>(device);
            record(*made, capacity_);
            made->finish();
            program_ = std::move(made);
        }
        while (!program_->reserve()) {
            set_aside_oldest();
        }
        return *program_;
    }

    /// The next prepare() records again: more changed than it is told.
    void outdate() { frames_.reset(); }

    /// Starts the program, to read `output` in the end, and `figures`, a few of them.
    void submit(const Tensor& output, const std::optional<Tensor>& figures = {}) {
        begun_.reserve(begun_.size() + 1);
        program_->submit();
        begun_.push_back({output, figures, std::nullopt, {}});
    }

    /// The output of the oldest run submitted and not finished; valid until the next call.
    std::span<const float> finish() {
        Begun oldest = std::move(begun_.at(0));
        begun_.erase(begun_.begin());
        if (oldest.aside) {
            aside_ = std::move(*oldest.aside);
            figures_ = std::move(oldest.figure_values);
            return aside_;
        }
        program_->wait();
        figures_ = read(oldest.figures);
        return program_->read(oldest.output);
    }

    /// Those of the run finished last.
    [[nodiscard]] const std::vector<float>& figures() const { return figures_; }

    [[nodiscard]] double operations() const { return program_ ? program_->flops() : 0; }

    /// Time of each dispatch of a run with the last input. Throws Error(device) before the first
    /// one, and where the device has no timestamps.
    [[nodiscard]] std::vector<DispatchTime> profile() const {
        if (!program_) {
            throw Error(ExitCode::device, "profile: no frame has been made yet");
        }
        return program_->profile();
    }

private:
    struct Begun {
        Tensor output;
        std::optional<Tensor> figures;
        std::optional<std::vector<float>> aside; ///< what came of it, no longer in the program
        std::vector<float> figure_values;        ///< with it
    };

    [[nodiscard]] std::vector<float> read(const std::optional<Tensor>& figures) const {
        if (!figures) {
            return {};
        }
        const auto values = program_->read(*figures);
        return {values.begin(), values.end()};
    }

    /// Makes room in the program; false where nothing of it is under way.
    bool set_aside_oldest() {
        const auto oldest =
            std::ranges::find_if(begun_, [](const Begun& begun) { return !begun.aside; });
        if (oldest == begun_.end()) {
            return false;
        }
        program_->wait();
        const auto values = program_->read(oldest->output);
        oldest->figure_values = read(oldest->figures);
        oldest->aside.emplace(values.begin(), values.end());
        return true;
    }

    std::unique_ptr<Program> program_;
    std::vector<Begun> begun_; ///< the oldest first
    std::vector<float> aside_;
    std::vector<float> figures_;
    std::optional<size_t> frames_;
    uint32_t capacity_ = 0; ///< events
};

} // namespace ecir
