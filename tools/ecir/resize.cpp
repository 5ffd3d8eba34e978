#include "tools/ecir/resize.hpp"

#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "runtime/error.hpp"

namespace ecir::cli {

PixelSize parse_size(const std::string& text) {
    PixelSize size;
    int used = 0;
    constexpr int kLargest = 1 << 15;
    if (std::sscanf(text.c_str(), "%dx%d%n", &size.width, &size.height, &used) != 2 ||
        static_cast<size_t>(used) != text.size() || size.width < 1 || size.height < 1 ||
        size.width > kLargest || size.height > kLargest) {
        throw Error(ExitCode::usage, "--size '" + text + "' is not WIDTHxHEIGHT, as in 240x180");
    }
    return size;
}

namespace {

io::Image resize(const io::Image& image, const PixelSize& size, int interpolation) {
    io::Image result = image;
    result.width = size.width;
    result.height = size.height;
    result.pixels.resize(static_cast<size_t>(size.width) * static_cast<size_t>(size.height) *
                         static_cast<size_t>(image.channels));
    const int type = CV_MAKETYPE(CV_32F, image.channels);
    // OpenCV takes no pointer to const for a matrix that it only reads.
    const cv::Mat from(image.height, image.width, type, const_cast<float*>(image.pixels.data()));
    cv::Mat to(size.height, size.width, type, result.pixels.data());
    cv::resize(from, to, to.size(), 0, 0, interpolation);
    return result;
}

} // namespace

io::Image resize_area(const io::Image& image, const PixelSize& size) {
    return resize(image, size, cv::INTER_AREA);
}

io::Image resize_cubic(const io::Image& image, const PixelSize& size) {
    return resize(image, size, cv::INTER_CUBIC);
}

Events scale_events(const EventView& events, int width, int height, const PixelSize& size) {
    Events scaled;
    for (size_t i = 0; i < events.size(); ++i) {
        scaled.push_back(events.t[i], static_cast<uint16_t>(events.x[i] * size.width / width),
                         static_cast<uint16_t>(events.y[i] * size.height / height), events.p[i]);
    }
    return scaled;
}

} // namespace ecir::cli
