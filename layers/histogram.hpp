#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/event_pack.hpp"
#include "runtime/program.hpp"

namespace ecir {

/// The event histogram E of the paper (section 4.2 and Voxelize in algorithm 1): channel 2i counts
/// the positive events of time interval i at each pixel, channel 2i + 1 the others.
///
/// Which events belong to an interval is decided on the host, by comparing normalised_time() with
/// normalised edges in float64 or whole numbers with each other; the kernel sees ranges of ordinals
/// and only counts, so its result is exact (up to 2^24 events of one pixel, interval and polarity).

/// Events begin, ..., end - 1 of the time-sorted input.
struct IntervalRange {
    uint32_t begin = 0;
    uint32_t end = 0;
    bool operator==(const IntervalRange&) const = default;
};
static_assert(sizeof(IntervalRange) == 8);

/// Edges of `intervals` equal parts of [-1, 1], each the correctly rounded (2 i - intervals) /
/// intervals.
std::vector<double> even_edges(uint32_t intervals);

/// linspace(-span, span, intervals + 1) as NumPy computes it.
std::vector<double> linspace_edges(double span, uint32_t intervals);

/// `paper` rule: interval i holds edge_i <= t < edge_{i+1}; the last one also t = its upper edge.
/// `events` must be sorted and lie in the exposure. Fewer than two edges are no interval. Throws
/// Error(bad_input) when the edges go back.
std::vector<IntervalRange> paper_intervals(const EventView& events, const Exposure& exposure,
                                           std::span<const double> edges);

/// `release` rule: interval i holds edge_i <= t <= edge_{i+1}, less every event at the latest time
/// of that set. Ranges of neighbours can overlap. Otherwise as paper_intervals().
std::vector<IntervalRange> release_intervals(const EventView& events, const Exposure& exposure,
                                             std::span<const double> edges);

/// eSL-Net's rule: intervals lie outwards from a frame's instant, normalised `time` rounded to
/// 1/1024 us, and are a `bins`-th of the exposure wide. Range bins + k holds the events whose
/// distance after the instant is k to k + 1 widths, range bins - 1 - k those before it, the nearer
/// end included, the farther one only at a distance of all `bins` widths; an event at the instant
/// is after it. `events` must be sorted and lie in the exposure, which must last no longer than
/// longest_exposure_us. Throws Error(bad_input) for an empty exposure, no bins, and a time outside
/// [-1, 1].
std::vector<IntervalRange> outward_intervals(const EventView& events, const Exposure& exposure,
                                             double time, uint32_t bins);

/// Records the count.
/// offsets    input [1][1][height * width + 1], PackedEvents::offset
/// marks      input [1][1][capacity], PackedEvents::mark; capacity >= the frame's number of events
/// positives  input [1][1][capacity + 1], PackedEvents::positives
/// intervals  input [1][1][2 * count], IntervalRange, `begin` never going back
/// counts     output of 2 * count channels in any layout; all of it but the halo is written, with
///            zeros in the channels that fill up the last block
/// Throws Error(resources) when two channels of `counts` exceed what the device can bind.
void record_event_histogram(Program& program, const Tensor& offsets, const Tensor& marks,
                            const Tensor& positives, const Tensor& intervals, const Tensor& counts);

} // namespace ecir
