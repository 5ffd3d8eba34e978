#pragma once
#include <cstdint>
#include <vector>

#include "layers/events.hpp"

namespace ecir {

/// Longest exposure, microseconds (107.4 s): the kernels scale event ticks by up to 2 (n - 1) + 1 <
/// 40 for n = 20 keypoints, and 40 x duration must fit 32 bits.
inline constexpr int64_t longest_exposure_us = (int64_t{1} << 32) / 40;

/// 2 (t - start) / (end - start) - 1 as one correctly rounded quotient of integers, so that an
/// event whose time equals an edge i/k of the exposure compares equal to it. `exposure` must not be
/// empty.
double normalised_time(int64_t t, const Exposure& exposure);

/// The events of one exposure, ordered by pixel and by time within a pixel, as the kernels read
/// them.
struct PackedEvents {
    int64_t duration = 0; ///< of the exposure, microseconds
    std::vector<uint32_t>
        offset; ///< [height * width + 1]: events of pixel p are offset[p] ... offset[p+1] - 1
    std::vector<float> time;    ///< float32(normalised_time)
    std::vector<uint32_t> mark; ///< polarity << 31 | ordinal of the event in the time-sorted input
    std::vector<int32_t> tick;  ///< microseconds since the exposure's start
    /// [size() + 1]: positive events before each, so that any range of a pixel's events is counted
    /// by a difference
    std::vector<uint32_t> positives;
    [[nodiscard]] size_t size() const { return mark.size(); }
};

/// Throws Error(bad_input) for an exposure that is empty or longer than longest_exposure_us, for an
/// event outside the exposure (see window()) or the width x height sensor, for times that go back,
/// and for 2^31 events or more.
void check_events(const EventView& events, const Exposure& exposure, uint32_t width,
                  uint32_t height);

/// Counting sort of `events`, which must be sorted by time and lie inside `exposure`. Throws as
/// check_events().
PackedEvents pack_events(const EventView& events, const Exposure& exposure, uint32_t width,
                         uint32_t height);

/// Times that run from 0 at the sensor's first event to 1 at its last, float32 in the packed order:
/// what the published keypoints see. All 0 when every event has the same time.
std::vector<float> release_times(const PackedEvents& events);

} // namespace ecir
