#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "layers/events.hpp"
#include "tools/io/file.hpp"
#include "tools/io/image.hpp"

namespace ecir::io {

/// A line of frames.csv: an image file and its time within the exposure.
struct FrameTime {
    std::string file;
    double t_normalised = 0; ///< -1 at the exposure's start, 1 at its end
    double t_us = 0;         ///< on the events' clock, microseconds
    std::string source = {}; ///< the blurry image it comes from, where there are several
};

/// t in [-1, 1] as a time on the events' clock, microseconds.
double absolute_time(const Exposure& exposure, double t_normalised);

/// The name of output frame `index`: 000000.png, 000001.png, ...
std::string frame_name(size_t index);

/// frames.csv, written line by line: `file,t_normalised,t_us`, numbers with the digits that restore
/// them exactly; `source` follows as a last column with `sources`. Errors as for FileWriter.
class FramesCsv {
public:
    FramesCsv(const std::filesystem::path& path, bool sources);
    void add(const FrameTime& frame);
    /// Ends the file, which is removed without.
    void close();

private:
    void flush();

    FileWriter file_;
    bool sources_;
    std::string text_; ///< not written yet
};

/// The whole list at once, with sources if a frame has one.
void write_frames_csv(const std::filesystem::path& path, std::span<const FrameTime> frames);

/// The images (.png, .tif, .tiff, .jpg, .jpeg) directly in a folder, sorted by name; hidden files
/// are left out. Throws Error(bad_input) when there is none.
std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder);

/// Reads them; all have one size and one number of channels, else Error(bad_input) names the first
/// that differs. The depth of each is in its `bits`.
std::vector<Image> read_frames(const std::filesystem::path& folder);

} // namespace ecir::io
