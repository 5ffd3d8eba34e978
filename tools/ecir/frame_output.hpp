#pragma once
#include <filesystem>
#include <memory>

#include "tools/io/frames.hpp"
#include "tools/io/image.hpp"
#include "tools/io/npy.hpp"
#include "tools/io/output.hpp"
#include "tools/io/video.hpp"

namespace ecir::cli {

/// Where `deblur` puts its frames: a folder of PNGs with frames.csv, a video, or a .npy, by what
/// the target is called. Frames are taken one at a time, so memory does not grow with their number.
class FrameOutput {
public:
    /// `frames` images of one size will come; a video plays at `fps` frames a second.
    /// Throws Error(usage) for an existing target without `overwrite`.
    FrameOutput(const std::filesystem::path& target, bool overwrite, size_t frames, double fps);

    /// The next frame; `time.file` is filled in here. All frames have a source, or none.
    void add(const io::Image& frame, io::FrameTime time);
    /// Makes the output appear under its name.
    void commit();

private:
    void start(const io::Image& first, bool sources);

    enum class Kind { folder, video, npy };
    Kind kind_;
    io::PendingOutput output_;
    size_t expected_;
    double fps_;
    size_t added_ = 0;
    std::unique_ptr<io::FramesCsv> list_;
    std::unique_ptr<io::VideoWriter> video_;
    std::unique_ptr<io::NpyWriter> array_;
};

} // namespace ecir::cli
