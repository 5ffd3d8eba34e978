#pragma once
#include <cstdint>

#include "layers/edi.hpp"

namespace ecir {

/// Moments by which contrast thresholds are judged; see layers/edi_threshold.hpp for what they mean
/// and shaders/edi_moments.comp for their sums. A pixel with more than edi_busy_events / bin^2
/// events counts as one without: it is faulty rather than telling.
///
/// ln(L(t) + e) = level + c+ N+(t) - c- N-(t), and of the terms only the level, one frame, depends
/// on the thresholds other than linearly. So the smoothed events and their derivatives (the fields)
/// are made once for a frame, and thresholds are tested at the cost of one frame.

/// Time windows in which the thresholds are tested: short, so that motion within one is straight,
/// and spread over the exposure.
inline constexpr uint32_t edi_windows = 16;
inline constexpr double edi_window_length = 5.0 / 128;

/// Pixels a side that a sensor needs for it.
inline constexpr uint32_t edi_smallest_side = 16;

/// Sums of a tile in a window.
inline constexpr uint32_t edi_moment_count = 7;

/// Where a window begins, normalised time.
constexpr double edi_window_start(uint32_t window) {
    return (2.0 * window + 1) / edi_windows - 1 - edi_window_length / 2;
}

/// Samples of the smoothed frames: every edi_sample_step-th binned pixel in x and y from the third
/// on to the last but two; tiles of edi_tile_samples x edi_tile_samples of them have one motion.
inline constexpr uint32_t edi_sample_step = 3;
inline constexpr uint32_t edi_tile_samples = 8;

/// Added to a tile's squared gradients of ln(L + e) over its samples, times c+ c-, before its
/// motion is solved for: what texture as weak as the events' noise has.
inline constexpr float edi_motion_ridge = 0.05F;

/// Geometry of the moments for a sensor: it is first binned to at most 480 pixels a side, then
/// smoothed and sampled.
struct EdiMomentShape {
    uint32_t bin;     ///< sensor pixels a side of a bin; what does not fill one is left out
    uint32_t width;   ///< of the binned frames
    uint32_t height;  ///< of the binned frames
    uint32_t columns; ///< of samples
    uint32_t rows;    ///< of samples
    uint32_t tile_columns;
    uint32_t tile_rows;
    [[nodiscard]] uint32_t tiles() const { return tile_columns * tile_rows; }
    /// Layout of the fields: see shaders/edi_moments.comp.
    [[nodiscard]] Layout fields() const { return {6 * edi_windows + 2, rows, columns}; }
    /// Layout of the moments: [edi_moment_count][edi_windows][tiles].
    [[nodiscard]] Layout moments() const { return {edi_moment_count, edi_windows, tiles()}; }
};

/// Throws Error(bad_input) for less than edi_smallest_side pixels a side.
EdiMomentShape edi_moment_shape(uint32_t width, uint32_t height);

/// Records the fields, an output or a temporary of EdiMomentShape::fields(), of input.blurry (block
/// 1, no halo) and the events. Throws Error(bad_input) for shapes that do not match; finish()
/// throws Error(resources) when they exceed what the device can bind.
void record_edi_fields(Program& program, const EdiInput& input, const Tensor& fields);

/// Records the moments, an output of EdiMomentShape::moments(), for input.thresholds. Errors as
/// record_edi_fields().
void record_edi_moments(Program& program, const EdiInput& input, const Tensor& fields,
                        const Tensor& moments);

} // namespace ecir
