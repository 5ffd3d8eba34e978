#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

namespace ecir::io {

/// A still picture: rows from the top, pixels interleaved (RGB order when channels is 3).
struct Image {
    int width = 0;
    int height = 0;
    int channels = 1;          ///< 1 grey or 3 colour
    int bits = 8;              ///< 8 or 16: depth of the file it came from or goes to
    std::vector<float> pixels; ///< height x width x channels, stored value / (2^bits - 1)
};

/// Reads PNG, JPEG or TIFF of 8 or 16 bits, grey or colour (alpha is dropped).
/// Throws Error(bad_input) naming the file when it is missing, truncated or of another kind.
Image read_image(const std::filesystem::path& path);

/// From bytes as OpenCV stores them: rows of 1 (grey), 3 (BGR) or 4 (BGRA) channels a pixel; alpha
/// is dropped.
Image image_from_bytes(std::span<const uint8_t> bytes, int width, int height, int channels);

/// Writes by extension (.png, .tif, .jpg); values are clipped to [0, 1] and rounded to `bits`.
/// Throws Error(resources) when the disk is full, Error(bad_input) when the folder cannot be
/// written.
void write_image(const std::filesystem::path& path, const Image& image);

/// Rec. 601 luminance, height x width; a grey image's own values.
std::vector<float> luminance(const Image& image);

} // namespace ecir::io
