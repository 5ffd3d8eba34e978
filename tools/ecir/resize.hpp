#pragma once
#include <string>
#include <vector>

#include "layers/events.hpp"
#include "tools/io/image.hpp"

namespace ecir::cli {

struct PixelSize {
    int width = 0;
    int height = 0;
};

/// WIDTHxHEIGHT. Throws Error(usage) for anything else.
PixelSize parse_size(const std::string& text);

/// The image at another size, by area averages.
io::Image resize_area(const io::Image& image, const PixelSize& size);

/// The image at another size, by cubic interpolation.
io::Image resize_cubic(const io::Image& image, const PixelSize& size);

/// Events of a width x height sensor at the pixels of another size that they fall into.
Events scale_events(const EventView& events, int width, int height, const PixelSize& size);

} // namespace ecir::cli
