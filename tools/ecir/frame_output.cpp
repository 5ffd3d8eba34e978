#include "tools/ecir/frame_output.hpp"

#include "tools/io/file.hpp"

namespace ecir::cli {

FrameOutput::FrameOutput(const std::filesystem::path& target, bool overwrite, size_t frames,
                         double fps)
    : kind_(io::is_video(target)                    ? Kind::video
            : io::lower_extension(target) == ".npy" ? Kind::npy
                                                    : Kind::folder),
      output_(target, kind_ == Kind::folder, overwrite), expected_(frames), fps_(fps) {}

void FrameOutput::start(const io::Image& first) {
    if (kind_ == Kind::video) {
        video_ = std::make_unique<io::VideoWriter>(output_.path(), first.width, first.height, fps_,
                                                   first.channels == 3);
    }
    if (kind_ == Kind::npy) {
        std::vector<size_t> shape{expected_, static_cast<size_t>(first.height),
                                  static_cast<size_t>(first.width)};
        if (first.channels == 3) {
            shape.push_back(3);
        }
        array_ = std::make_unique<io::NpyWriter>(output_.path(), shape);
    }
}

void FrameOutput::add(const io::Image& frame, io::FrameTime time) {
    if (times_.empty()) {
        start(frame);
    }
    time.file = io::frame_name(times_.size());
    switch (kind_) {
    case Kind::folder:
        io::write_image(output_.path() / time.file, frame);
        break;
    case Kind::video:
        video_->write(frame);
        break;
    case Kind::npy:
        array_->add(frame.pixels);
        break;
    }
    times_.push_back(std::move(time));
}

void FrameOutput::commit() {
    if (kind_ == Kind::folder) {
        io::write_frames_csv(output_.path() / "frames.csv", times_);
    }
    if (kind_ == Kind::video) {
        video_->close();
    }
    if (kind_ == Kind::npy) {
        array_->close();
    }
    output_.commit();
}

} // namespace ecir::cli
