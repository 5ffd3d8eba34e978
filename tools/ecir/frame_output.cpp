#include "tools/ecir/frame_output.hpp"

#include "tools/io/file.hpp"

namespace ecir::cli {

FrameOutput::FrameOutput(const std::filesystem::path& target, bool overwrite, size_t frames,
                         double fps)
    : kind_(io::is_video(target)                    ? Kind::video
            : io::lower_extension(target) == ".npy" ? Kind::npy
                                                    : Kind::folder),
      output_(target, kind_ == Kind::folder, overwrite), expected_(frames), fps_(fps) {}

void FrameOutput::start(const io::Image& first, bool sources) {
    if (kind_ == Kind::folder) {
        list_ = std::make_unique<io::FramesCsv>(output_.path() / "frames.csv", sources);
    }
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
    if (added_ == 0) {
        start(frame, !time.source.empty());
    }
    time.file = io::frame_name(added_++);
    switch (kind_) {
    case Kind::folder:
        io::write_image(output_.path() / time.file, frame);
        list_->add(time);
        break;
    case Kind::video:
        video_->write(frame);
        break;
    case Kind::npy:
        array_->add(frame.pixels);
        break;
    }
}

void FrameOutput::commit() {
    if (kind_ == Kind::folder) {
        list_->close();
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
