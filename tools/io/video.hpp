#pragma once
#include <cstddef>
#include <filesystem>
#include <memory>

#include "tools/io/image.hpp"

namespace ecir::io {

/// Whether the extension is that of a video: .mp4, .mkv or .avi.
bool is_video(const std::filesystem::path& path);

/// Writes a video: H.264 (.mp4, .mkv) or Motion JPEG (.avi), MPEG-4 where these are missing.
/// These store even sizes only, so an odd one is padded by repeating the last column or row.
class VideoWriter {
public:
    /// `width` x `height` in pixels, `fps` frames a second (from 0.01 to 1e6).
    /// Throws Error(bad_input) when the file cannot be created or no codec takes it,
    /// Error(resources) when the disk is full.
    VideoWriter(const std::filesystem::path& path, int width, int height, double fps, bool colour);
    /// Without close() the file is left as it is, not checked.
    ~VideoWriter();
    VideoWriter(const VideoWriter&) = delete;
    VideoWriter& operator=(const VideoWriter&) = delete;

    /// Appends a frame, clipped to [0, 1] and rounded to 8 bits. Grey frames may go into a colour
    /// video; a colour frame in a grey one, or another size, is an Error(bad_input).
    void write(const Image& frame);
    /// Ends the file and reads it back; Error(resources) unless every frame is there.
    void close();
    [[nodiscard]] size_t frames() const { return frames_; }

private:
    struct Encoder;
    std::filesystem::path path_;
    int width_;
    int height_;
    bool colour_;
    size_t frames_ = 0;
    std::unique_ptr<Encoder> encoder_;
};

} // namespace ecir::io
