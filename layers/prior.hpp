#pragma once
#include <cstdint>

#include "layers/edi.hpp"
#include "layers/instant.hpp"

namespace ecir {

/// The event-driven prior of the fusion network (tools/train/prior.py): the double integral of
/// layers/edi.hpp, but the level runs to that of the next event during the last 0.05 of normalised
/// time before it, and frames are cut at 2. Times are float32. Rounding
/// grows with the number of events of one sign: relative to L + e, some 1e-5 for 700 of them.

/// Pixels with more events than this are taken as pixels without events, since lavapipe's loops
/// bear no more in these kernels. In an exposure of 0.1 s only faulty pixels have so many; in one
/// of a second and more, fine texture can.
inline constexpr uint32_t prior_busy_events = 768;

/// How many such pixels there are. `events` must lie inside the image.
size_t prior_busy_pixels(const EventView& events, uint32_t width, uint32_t height);

/// Windows of the local motion (layers/motion.hpp), between even times from -1 to 1.
inline constexpr uint32_t prior_windows = 32;

/// The events and the frame of one exposure as tensors of a program.
/// offsets     input [1][1][height * width + 1], PackedEvents::offset
/// times       input [1][1][capacity], PackedEvents::time
/// marks       input [1][1][capacity], PackedEvents::mark
/// positives   input [1][1][capacity + 1], PackedEvents::positives
/// blurry      1 channel, height x width, any layout; finite, from 0 to 1 but for rounding
/// thresholds  input [1][1][2], EdiThresholds, from 0.001 to 10
struct PriorInput {
    Tensor offsets;
    Tensor times;
    Tensor marks;
    Tensor positives;
    Tensor blurry;
    Tensor thresholds;
};

/// What is made of them for an exposure, all of any layout.
/// anchors     9 channels: the prior at the anchors
/// context     9 channels: the blurry frame, log2(1 + events) / 4 between the anchors
/// base        1 channel: the prior's logarithm without the events' steps
/// logarithms  prior_windows + 1 channels at half the size rounded up, for record_motion()
struct PriorExposure {
    Tensor anchors;
    Tensor context;
    Tensor base;
    Tensor logarithms;
};

/// Records it. Throws Error(bad_input) for shapes that do not match; finish() throws
/// Error(resources) when a tensor exceeds what the device can bind (as record_prior_frame()).
void record_prior(Program& program, const PriorInput& input, const PriorExposure& exposure);

/// Channels of the head's input.
inline constexpr uint32_t plane_count = anchor_count + 7;

/// Where each pixel is among its events, from one wanted time to the next.
Layout prior_state_layout(uint32_t height, uint32_t width);

/// Records what the head sees of the prior at a wanted time: the channels 0, 1 and 11 to 15 of
/// `planes` (shaders/prior_frame.comp).
/// base     from record_prior()
/// instant  one channel of instant_layout()
/// state    of prior_state_layout(), cleared before the first wanted time of an exposure. The order
/// of
///          times does not matter to the result; a CPU driver takes the least time where they rise.
/// planes   plane_count channels, height x width, any layout
/// Throws as record_prior().
void record_prior_frame(Program& program, const PriorInput& input, const Tensor& base,
                        const Tensor& instant, const Tensor& state, const Tensor& planes);

} // namespace ecir
