#pragma once
#include <array>
#include <cstdint>

#include "layers/event_pack.hpp"
#include "runtime/program.hpp"

namespace ecir {

inline constexpr uint32_t min_keypoints = 2;
inline constexpr uint32_t max_keypoints = 20;

/// Keypoint selection (figure 2a of the paper): pivot i = (2 i - (n - 1)) / (n - 1) of [-1, 1]
/// moves to the event of its pixel that is nearest to it within its own cell, and stays where there
/// is none. Cells meet half-way between pivots, an event on the border belongs to the later one,
/// and of two events at the same distance the earlier one counts. Cells and distances are compared
/// in exact integers; the keypoint's value is the event's time, correctly rounded to float32.
///
/// The `paper` rule measures time over the exposure, -1 to 1. The `release` rule measures it from 0
/// (the sensor's first event in the exposure) to 1 (its last) against the same pivots, a defect
/// that the published weights expect: only the pivots of the later half ever move.

/// What the kernel needs to place events, as 32-bit integers: an event at tick u lies in cell
/// floor(a / 2 span) with a = scale (u - origin) + bias, and |a mod 2 span - span| is proportional
/// to its distance from the pivot. 2 n span < 2^32 bounds a (see longest_exposure_us). A span of
/// 0 moves no pivot.
struct KeypointRule {
    uint32_t scale = 0;
    uint32_t origin = 0;
    uint32_t bias = 0;
    uint32_t span = 0;
};
static_assert(sizeof(KeypointRule) == 16);

/// For times = PackedEvents::time.
KeypointRule paper_keypoint_rule(const PackedEvents& events, uint32_t n);
/// For times = release_times(events).
KeypointRule release_keypoint_rule(const PackedEvents& events, uint32_t n);

/// The n pivots, float32.
std::array<float, max_keypoints> keypoint_pivots(uint32_t n);

/// Records the selection.
/// offsets    input [1][1][height * width + 1], PackedEvents::offset
/// times      input [1][1][capacity], the rule's times
/// ticks      input [1][1][capacity], PackedEvents::tick
/// rule       input [1][1][4], one KeypointRule
/// keypoints  output in any layout: channels first_channel, ..., first_channel + n - 1 are written,
/// and
///            zeros into the channels that fill up the last block if the keypoints are the tensor's
///            last channels
/// Throws Error(bad_input) for n outside 2 ... 20 or channels outside `keypoints`.
void record_keypoints(Program& program, const Tensor& offsets, const Tensor& times,
                      const Tensor& ticks, const Tensor& rule, const Tensor& keypoints,
                      uint32_t first_channel, uint32_t n);

} // namespace ecir
