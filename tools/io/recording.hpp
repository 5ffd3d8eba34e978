#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "layers/events.hpp"
#include "tools/io/frame_source.hpp"

namespace ecir::io {

/// Images with their exposures, and the events, in one of two forms:
/// - a folder with exposures.csv (`file,start_us,end_us`, a line an image), the images it names,
///   and one events file, told by content among the folder's other files;
/// - a camera's file that holds frames and events (AEDAT 4).
struct Recording {
    struct Item {
        /// An image's path within the folder; "frame 12" of a camera's file. A
        /// std::filesystem::path would take ten times the memory, and these are all that grows with
        /// a recording's length.
        std::string name;
        Exposure exposure; ///< start < end, on the events' clock
        size_t frame = 0;  ///< of a camera's file, which one
    };
    std::vector<Item> items; ///< in the order of exposures.csv or of the file
    std::filesystem::path events;
    std::filesystem::path place; ///< the folder or the file; empty where names are whole paths
    std::shared_ptr<FrameSource> frames; ///< of a camera's file; none: images are files
    std::string note;                    ///< what a person should know; empty: nothing

    /// For messages: the image's path, or the camera's file and which frame.
    [[nodiscard]] std::string full_name(const Item& item) const;
    /// Errors as of read_image() and FrameSource::read().
    [[nodiscard]] Image read(const Item& item) const;
};

/// Finds the parts without reading images or events. Throws Error(bad_input) naming the file and
/// line: exposures.csv missing, empty or malformed, an image missing or outside the folder, an
/// exposure that does not end after its start, no events file or several; a camera's file damaged
/// or without frames.
Recording open_recording(const std::filesystem::path& path);

/// Whether a file, by its content, is one that open_recording() takes: of a camera, with frames.
/// Throws Error(bad_input) when it cannot be opened or is damaged.
bool is_camera_file(const std::filesystem::path& path);

} // namespace ecir::io
