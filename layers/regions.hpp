#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/activity.hpp"

namespace ecir {

/// Pixels of an image, the right and lower ends excluded.
struct PixelRect {
    uint32_t left = 0;
    uint32_t top = 0;
    uint32_t right = 0;
    uint32_t bottom = 0;
    [[nodiscard]] uint32_t width() const { return right - left; }
    [[nodiscard]] uint32_t height() const { return bottom - top; }
    [[nodiscard]] size_t area() const { return size_t{width()} * height(); }
    [[nodiscard]] bool contains(uint32_t x, uint32_t y) const {
        return x >= left && x < right && y >= top && y < bottom;
    }
    bool operator==(const PixelRect&) const = default;
};

/// A part of an image that a method computes as an image of its own.
struct Window {
    PixelRect computed; ///< starts at multiples of window_grid
    PixelRect kept;     ///< far enough from the sides of `computed` that are inside the image
};

/// Windows start at multiples of this, so that the cells, strides and levels of the networks (up to
/// 16 pixels) fall where they do in the whole image.
inline constexpr uint32_t window_grid = 16;
/// Their sides are multiples of this but where the image ends, so that few sizes occur.
inline constexpr uint32_t window_step = 16;

/// How a method is run in windows.
struct RegionRule {
    /// Pixels around what is kept that a method must see for it.
    uint32_t context = 0;
    /// Pixels over which the correction fades out around the active cells; up to activity_cell.
    uint32_t fade = 0;
};

/// The parts of an image that are computed, and what is kept of them; the rest is the blurry frame.
struct Regions {
    std::vector<Window> windows; ///< none: there is nothing to compute
    /// The computed frames count by so much, height x width, 0 to 1; empty: everywhere in full.
    std::vector<float> weight;
    [[nodiscard]] bool whole(uint32_t width, uint32_t height) const {
        return windows.size() == 1 && windows.front().computed == PixelRect{0, 0, width, height};
    }
};

/// Windows around the active cells of an image of width x height: around groups of cells that
/// touch, merged while that makes less to compute. Where they came to `most_share` of the image or
/// more, the whole image is the only window, and everything counts in full.
Regions find_regions(const ActivityMap& map, const RegionRule& rule, uint32_t width,
                     uint32_t height);

/// Share of the image's area that windows are worth computing up to.
inline constexpr double most_window_share = 0.8;

/// The events inside a rectangle, in its coordinates.
Events crop_events(const EventView& events, const PixelRect& rect);

/// The pixels inside a rectangle of an image `width` wide.
std::vector<float> crop_image(std::span<const float> image, uint32_t width, const PixelRect& rect);

} // namespace ecir
