#include "tools/io/video.hpp"

#include <algorithm>
#include <array>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"
#include "tools/io/opencv_log.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

struct VideoWriter::Encoder {
    cv::VideoWriter writer;
    cv::Mat frame; ///< of even size, BGR
};

namespace {

std::vector<std::string> codecs_for(const fs::path& path) {
    const std::string extension = lower_extension(path);
    if (extension == ".mp4") {
        return {"avc1", "mp4v"};
    }
    if (extension == ".mkv") {
        return {"H264", "mp4v"};
    }
    if (extension == ".avi") {
        return {"MJPG", "XVID"};
    }
    throw Error(ExitCode::bad_input, path.string() + ": unknown video extension '" + extension +
                                         "'; use .mp4, .mkv or .avi");
}

uint8_t to_byte(float value) {
    // Written so that NaN becomes 0.
    const float clipped = value > 0.0F ? std::min(value, 1.0F) : 0.0F;
    return static_cast<uint8_t>(clipped * 255.0F + 0.5F);
}

std::string size_text(int width, int height) {
    return std::to_string(width) + " x " + std::to_string(height);
}

size_t count_frames(const fs::path& path) {
    cv::VideoCapture video(path.string(), cv::CAP_FFMPEG);
    size_t count = 0;
    while (video.isOpened() && video.grab()) {
        ++count;
    }
    return count;
}

} // namespace

bool is_video(const fs::path& path) {
    constexpr std::array<const char*, 3> known = {".mp4", ".mkv", ".avi"};
    return std::ranges::find(known, lower_extension(path)) != known.end();
}

VideoWriter::VideoWriter(const fs::path& path, int width, int height, double fps, bool colour)
    : path_(path), width_(width), height_(height), colour_(colour),
      encoder_(std::make_unique<Encoder>()) {
    silence_opencv();
    const auto codecs = codecs_for(path);
    if (width < 1 || height < 1 || !(fps >= 0.01 && fps <= 1e6)) {
        throw Error(ExitCode::bad_input, path.string() + ": cannot write a video of " +
                                             size_text(width, height) + " at " +
                                             std::to_string(fps) +
                                             " frames a second; choose another size or rate");
    }
    // Both name their reason, where OpenCV only fails; then it also deletes what is at the path.
    write_file(path, {});
    check_can_grow(path);
    const cv::Size even(width + width % 2, height + height % 2);
    for (const auto& codec : codecs) {
        const int tag = cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]);
        if (encoder_->writer.open(path.string(), cv::CAP_FFMPEG, tag, fps, even, true)) {
            encoder_->frame.create(even, CV_8UC3);
            return;
        }
    }
    throw Error(ExitCode::bad_input,
                path.string() + ": OpenCV has no encoder for " + size_text(width, height) + " at " +
                    std::to_string(fps) +
                    " frames a second; choose another container, or a folder of images");
}

VideoWriter::~VideoWriter() = default;

void VideoWriter::write(const Image& frame) {
    if (frame.width != width_ || frame.height != height_ || (frame.channels == 3 && !colour_)) {
        throw Error(ExitCode::bad_input, path_.string() + ": frame " + std::to_string(frames_) +
                                             " is " + size_text(frame.width, frame.height) +
                                             " with " + std::to_string(frame.channels) +
                                             " channels, the video " + size_text(width_, height_) +
                                             (colour_ ? " in colour" : " in grey") +
                                             "; write frames of one kind");
    }
    const auto channels = static_cast<size_t>(frame.channels);
    cv::Mat& out = encoder_->frame;
    for (int row = 0; row < out.rows; ++row) {
        const auto source_row = static_cast<size_t>(std::min(row, height_ - 1));
        for (int column = 0; column < out.cols; ++column) {
            const auto source_column = static_cast<size_t>(std::min(column, width_ - 1));
            const size_t at = (source_row * static_cast<size_t>(width_) + source_column) * channels;
            auto& pixel = out.at<cv::Vec3b>(row, column);
            for (size_t c = 0; c < 3; ++c) {
                pixel[static_cast<int>(2 - c)] = to_byte(frame.pixels[at + c % channels]);
            }
        }
    }
    encoder_->writer.write(out);
    ++frames_;
}

void VideoWriter::close() {
    encoder_->writer.release();
    // OpenCV ignores write errors, a full disk among them.
    check_can_grow(path_);
    const size_t found = count_frames(path_);
    if (found != frames_) {
        throw Error(ExitCode::resources,
                    path_.string() + ": " + std::to_string(found) + " of " +
                        std::to_string(frames_) +
                        " frames can be read back; free some space or write to another disk");
    }
}

} // namespace ecir::io
