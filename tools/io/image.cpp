#include "tools/io/image.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <span>
#include <string>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"
#include "tools/io/opencv_log.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

using Bytes = std::span<const uint8_t>;

enum class Kind { png, jpeg, tiff, other };

bool starts_with(Bytes bytes, std::initializer_list<uint8_t> magic) {
    return bytes.size() >= magic.size() && std::equal(magic.begin(), magic.end(), bytes.begin());
}

Kind kind_of(Bytes bytes) {
    if (starts_with(bytes, {0x89, 'P', 'N', 'G', 0x0d, 0x0a, 0x1a, 0x0a})) {
        return Kind::png;
    }
    if (starts_with(bytes, {0xff, 0xd8, 0xff})) {
        return Kind::jpeg;
    }
    if (starts_with(bytes, {'I', 'I', 42, 0}) || starts_with(bytes, {'M', 'M', 0, 42}) ||
        starts_with(bytes, {'I', 'I', 43, 0}) || starts_with(bytes, {'M', 'M', 0, 43})) {
        return Kind::tiff;
    }
    return Kind::other;
}

/// Whether the chunks reach IEND. Decoders tend to return the missing rows as grey or black.
bool png_complete(Bytes bytes) {
    size_t at = 8;
    while (at + 12 <= bytes.size()) {
        const size_t length = (size_t{bytes[at]} << 24U) | (size_t{bytes[at + 1]} << 16U) |
                              (size_t{bytes[at + 2]} << 8U) | size_t{bytes[at + 3]};
        if (length > bytes.size() - at - 12) {
            return false;
        }
        if (std::memcmp(bytes.data() + at + 4, "IEND", 4) == 0) {
            return true;
        }
        at += length + 12;
    }
    return false;
}

/// Whether the segments reach the end marker. They are walked, since an embedded thumbnail has an
/// end marker of its own and cameras append data after the last one.
bool jpeg_complete(Bytes bytes) {
    size_t at = 2;
    while (at + 1 < bytes.size()) {
        const uint8_t marker = bytes[at + 1];
        if (bytes[at] != 0xff || marker == 0 || (marker >= 0xd0 && marker <= 0xd7)) {
            ++at; // inside a scan: coded data, a stuffed byte or a restart marker
        } else if (marker == 0xff) {
            ++at; // fill byte
        } else if (marker == 0xd9) {
            return true;
        } else if (at + 3 < bytes.size()) {
            at += 2 + ((size_t{bytes[at + 2]} << 8U) | size_t{bytes[at + 3]});
        } else {
            return false;
        }
    }
    return false;
}

cv::Mat decode(const fs::path& path, const std::vector<uint8_t>& bytes, Kind kind) {
    // No turning by EXIF: the events are not turned either.
    int mode = cv::IMREAD_ANYDEPTH | cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION;
    constexpr size_t colour_type = 25;
    constexpr uint8_t grey_with_alpha = 4;
    if (kind == Kind::png && bytes[colour_type] == grey_with_alpha) {
        mode &= ~cv::IMREAD_ANYCOLOR; // would come back as three equal channels
    }
    try {
        return cv::imdecode(bytes, mode);
    } catch (const cv::Exception& error) {
        if (error.code == cv::Error::StsNoMem) {
            throw Error(ExitCode::resources,
                        path.string() + ": not enough memory to decode this image; free some");
        }
        throw Error(ExitCode::bad_input,
                    path.string() + ": cannot decode: " + error.err + "; export the image again");
    }
}

/// Stored values to [0, 1], colour from OpenCV's BGR order to RGB.
template <class Stored> void to_floats(const cv::Mat& mat, float range, Image& image) {
    const auto channels = static_cast<size_t>(image.channels);
    const auto stored = static_cast<size_t>(mat.channels());
    const auto width = static_cast<size_t>(image.width);
    float* out = image.pixels.data();
    for (int row = 0; row < mat.rows; ++row) {
        const auto* in = mat.ptr<Stored>(row);
        for (size_t pixel = 0; pixel < width; ++pixel) {
            for (size_t c = 0; c < channels; ++c) {
                *out++ = static_cast<float>(in[pixel * stored + channels - 1 - c]) / range;
            }
        }
    }
}

/// Of 8 or 16 bits; a fourth channel is dropped.
Image to_image(const cv::Mat& mat) {
    Image image;
    image.width = mat.cols;
    image.height = mat.rows;
    image.channels = std::min(mat.channels(), 3);
    image.bits = mat.depth() == CV_8U ? 8 : 16;
    image.pixels.resize(mat.total() * static_cast<size_t>(image.channels));
    if (image.bits == 8) {
        to_floats<uint8_t>(mat, 255.0F, image);
    } else {
        to_floats<uint16_t>(mat, 65535.0F, image);
    }
    return image;
}

template <class Stored> cv::Mat from_floats(const Image& image, float range) {
    cv::Mat mat(image.height, image.width,
                CV_MAKETYPE(cv::DataType<Stored>::depth, image.channels));
    const auto channels = static_cast<size_t>(image.channels);
    const float* in = image.pixels.data();
    for (int row = 0; row < mat.rows; ++row) {
        auto* out = mat.ptr<Stored>(row);
        for (size_t pixel = 0; pixel < static_cast<size_t>(image.width); ++pixel) {
            for (size_t c = 0; c < channels; ++c) {
                const float value = *in++;
                // Written so that NaN becomes 0.
                const float clipped = value > 0.0F ? std::min(value, 1.0F) : 0.0F;
                out[pixel * channels + channels - 1 - c] =
                    static_cast<Stored>(clipped * range + 0.5F);
            }
        }
    }
    return mat;
}

void check_image(const fs::path& path, const Image& image) {
    const bool known = (image.channels == 1 || image.channels == 3) &&
                       (image.bits == 8 || image.bits == 16) && image.width > 0 && image.height > 0;
    const size_t expected = known ? static_cast<size_t>(image.width) *
                                        static_cast<size_t>(image.height) *
                                        static_cast<size_t>(image.channels)
                                  : 0;
    if (!known || image.pixels.size() != expected) {
        throw Error(ExitCode::bad_input,
                    path.string() + ": cannot write an image of " + std::to_string(image.width) +
                        " x " + std::to_string(image.height) + " with " +
                        std::to_string(image.channels) + " channels, " +
                        std::to_string(image.bits) + " bits and " +
                        std::to_string(image.pixels.size()) +
                        " values; give 1 or 3 channels, 8 or 16 bits and a value for each");
    }
}

} // namespace

Image read_image(const fs::path& path) {
    silence_opencv();
    const std::vector<uint8_t> bytes = read_file(path);
    const Kind kind = kind_of(bytes);
    if (kind == Kind::other) {
        throw Error(ExitCode::bad_input,
                    path.string() +
                        (bytes.empty() ? ": the file is empty" : ": not PNG, JPEG or TIFF") +
                        "; convert the image to one of PNG, JPEG or TIFF");
    }
    if ((kind == Kind::png && !png_complete(bytes)) ||
        (kind == Kind::jpeg && !jpeg_complete(bytes))) {
        throw Error(ExitCode::bad_input,
                    path.string() + ": truncated: the image's end mark is missing in " +
                        std::to_string(bytes.size()) + " bytes; copy the file again");
    }
    const cv::Mat mat = decode(path, bytes, kind);
    if (mat.empty()) {
        throw Error(ExitCode::bad_input,
                    path.string() + ": truncated or damaged image; copy or export it again");
    }
    if (mat.depth() != CV_8U && mat.depth() != CV_16U) {
        throw Error(ExitCode::bad_input, path.string() + ": neither 8 nor 16 bits a channel (" +
                                             cv::typeToString(mat.type()) +
                                             "); convert the image to one of these");
    }
    return to_image(mat);
}

Image image_from_bytes(std::span<const uint8_t> bytes, int width, int height, int channels) {
    // OpenCV's headers are for reading, too, but take no pointer to const.
    const cv::Mat mat(height, width, CV_8UC(channels), const_cast<uint8_t*>(bytes.data()));
    return to_image(mat);
}

void write_image(const fs::path& path, const Image& image) {
    silence_opencv();
    check_image(path, image);
    const std::string extension = lower_extension(path);
    constexpr std::array<const char*, 5> known = {".png", ".tif", ".tiff", ".jpg", ".jpeg"};
    if (std::ranges::find(known, extension) == known.end()) {
        throw Error(ExitCode::bad_input, path.string() + ": unknown image extension '" + extension +
                                             "'; use .png, .tif or .jpg");
    }
    if (image.bits == 16 && extension.starts_with(".jp")) {
        throw Error(ExitCode::bad_input,
                    path.string() + ": JPEG holds 8 bits, not 16; use .png or .tif");
    }
    const cv::Mat mat = image.bits == 8 ? from_floats<uint8_t>(image, 255.0F)
                                        : from_floats<uint16_t>(image, 65535.0F);
    std::vector<uint8_t> bytes;
    try {
        if (!cv::imencode(extension, mat, bytes)) {
            bytes.clear();
        }
    } catch (const cv::Exception& error) {
        throw Error(ExitCode::resources,
                    path.string() + ": cannot encode: " + error.err + "; use .png");
    }
    if (bytes.empty()) {
        throw Error(ExitCode::resources, path.string() + ": cannot encode this image; use .png");
    }
    write_file(path, {bytes});
}

std::vector<float> luminance(const Image& image) {
    if (image.channels == 1) {
        return image.pixels;
    }
    std::vector<float> result(image.pixels.size() / 3);
    for (size_t i = 0; i < result.size(); ++i) {
        const float* rgb = image.pixels.data() + 3 * i;
        result[i] = 0.299F * rgb[0] + 0.587F * rgb[1] + 0.114F * rgb[2];
    }
    return result;
}

} // namespace ecir::io
