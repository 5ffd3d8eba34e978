#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/event_pack.hpp"
#include "runtime/program.hpp"

namespace ecir {

/// Event-based double integral (EDI): with the steps E(t) = c+ N+(t) - c- N-(t), where N+(t) and
/// N-(t) count the pixel's positive and other events from the exposure's start up to and including
/// t,
///     L(t) + e = (B + e) exp(E(t)) / mean over [-1, 1] of exp(E),    e = 0.01.
/// The mean is exact: E is constant between events. So the mean of L over the exposure is B, and a
/// pixel without events keeps B. Any number of events stays finite: ln(L + e) is cut at 80.

/// Contrast thresholds: the steps of ln(L + e) at a positive event and at a negative one.
struct EdiThresholds {
    float positive = 0.2F;
    float negative = 0.2F;
    bool operator==(const EdiThresholds&) const = default;
};
static_assert(sizeof(EdiThresholds) == 8);

/// What the kernel reads for d normalised `times` in any order: the times ascending as float32,
/// then the frame that each belongs to. Throws Error(bad_input) for a time outside [-1, 1].
std::vector<uint32_t> edi_schedule(std::span<const double> times);

/// The events and the frame of one exposure as tensors of a program.
/// offsets     input [1][1][height * width + 1], PackedEvents::offset
/// times       input [1][1][capacity], PackedEvents::time
/// marks       input [1][1][capacity], PackedEvents::mark
/// blurry      height x width, any layout, of which channel `blurry_channel` counts
/// thresholds  input [1][1][2], EdiThresholds
struct EdiInput {
    Tensor offsets;
    Tensor times;
    Tensor marks;
    Tensor blurry;
    Tensor thresholds;
    uint32_t blurry_channel = 0;
};

/// Pixels with more events than this get a workgroup of their own.
inline constexpr uint32_t edi_busy_events = 4096;

/// Length of the list of such pixels for at most `capacity` events.
inline uint32_t edi_busy_length(uint32_t capacity) {
    return 1 + capacity / (edi_busy_events + 1);
}

/// The list: how many such pixels there are, and which. Throws Error(bad_input) when a pixel has
/// more than 4 million events, which neither a GPU's time limit nor lavapipe's loops can bear.
std::vector<uint32_t> edi_busy_pixels(const PackedEvents& events);

/// Records the frames, float32 and unclipped.
/// schedule    input [1][2][d], edi_schedule()
/// busy        input [1][1][edi_busy_length(capacity)], edi_busy_pixels()
/// frames      output, d channels of the frame's height and width in any layout of block 1
/// Throws Error(bad_input) for shapes that do not match, Error(resources) when one frame exceeds
/// what the device can bind.
void record_edi(Program& program, const EdiInput& input, const Tensor& schedule, const Tensor& busy,
                const Tensor& frames);

} // namespace ecir
