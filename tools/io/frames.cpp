#include "tools/io/frames.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <string>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

/// The shortest digits that restore the value, never with an exponent.
std::string exact(double value) {
    std::array<char, 400> text{};
    const auto [end, problem] = std::to_chars(text.data(), text.data() + text.size(),
                                              value == 0 ? 0.0 : value, std::chars_format::fixed);
    return problem == std::errc() ? std::string(text.data(), end) : std::string();
}

std::string kind_text(const Image& image) {
    return std::to_string(image.width) + " x " + std::to_string(image.height) +
           (image.channels == 1 ? " grey" : " colour");
}

} // namespace

double absolute_time(const Exposure& exposure, double t_normalised) {
    return static_cast<double>(exposure.start) +
           (t_normalised + 1.0) * 0.5 * static_cast<double>(exposure.duration());
}

std::string frame_name(size_t index) {
    const std::string digits = std::to_string(index);
    return std::string(6 - std::min<size_t>(digits.size(), 6), '0') + digits + ".png";
}

FramesCsv::FramesCsv(const fs::path& path, bool sources)
    : file_(path), sources_(sources),
      text_(sources ? "file,t_normalised,t_us,source\n" : "file,t_normalised,t_us\n") {}

void FramesCsv::add(const FrameTime& frame) {
    constexpr size_t most = size_t{1} << 16U;
    text_ += frame.file + "," + exact(frame.t_normalised) + "," + exact(frame.t_us) +
             (sources_ ? "," + frame.source : "") + "\n";
    if (text_.size() > most) {
        flush();
    }
}

void FramesCsv::flush() {
    file_.write({reinterpret_cast<const uint8_t*>(text_.data()), text_.size()});
    text_.clear();
}

void FramesCsv::close() {
    flush();
    file_.close();
}

void write_frames_csv(const fs::path& path, std::span<const FrameTime> frames) {
    FramesCsv list(path, std::ranges::any_of(
                             frames, [](const FrameTime& frame) { return !frame.source.empty(); }));
    for (const auto& frame : frames) {
        list.add(frame);
    }
    list.close();
}

std::vector<fs::path> list_images(const fs::path& folder) {
    constexpr std::array<const char*, 5> known = {".png", ".tif", ".tiff", ".jpg", ".jpeg"};
    std::error_code problem;
    std::error_code ignored; // a link that leads nowhere is no regular file
    std::vector<fs::path> found;
    for (const auto& entry : fs::directory_iterator(folder, problem)) {
        const bool image = std::ranges::find(known, lower_extension(entry.path())) != known.end();
        if (image && !entry.path().filename().string().starts_with('.') &&
            entry.is_regular_file(ignored)) {
            found.push_back(entry.path());
        }
    }
    if (problem) {
        throw system_error(problem.value(), folder, "cannot list");
    }
    if (found.empty()) {
        throw Error(ExitCode::bad_input, folder.string() +
                                             ": no images (.png, .tif, .jpg) in this folder; give "
                                             "the folder that holds the frames");
    }
    std::ranges::sort(found);
    return found;
}

std::vector<Image> read_frames(const fs::path& folder) {
    std::vector<Image> frames;
    for (const auto& path : list_images(folder)) {
        frames.push_back(read_image(path));
        const Image& image = frames.back();
        if (image.width != frames.front().width || image.height != frames.front().height ||
            image.channels != frames.front().channels) {
            throw Error(ExitCode::bad_input,
                        path.string() + ": " + kind_text(image) + ", the frames before it " +
                            kind_text(frames.front()) + "; keep frames of one kind in a folder");
        }
    }
    return frames;
}

} // namespace ecir::io
