#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "layers/events.hpp"

namespace ecir::io {

/// A recording in the form of a folder: exposures.csv (`file,start_us,end_us`, a line an image),
/// the images it names, and one events file, told by content among the folder's other files.
struct Recording {
    struct Item {
        /// Full path. A std::filesystem::path would take ten times the memory, and these are all
        /// that grows with a recording's length.
        std::string image;
        Exposure exposure; ///< start < end, on the events' clock
    };
    std::vector<Item> items; ///< in the order of exposures.csv
    std::filesystem::path events;
};

/// Finds the parts without reading images or events. Throws Error(bad_input) naming the file and
/// line: exposures.csv missing, empty or malformed, an image missing or outside the folder, an
/// exposure that does not end after its start, no events file or several.
Recording open_recording(const std::filesystem::path& folder);

} // namespace ecir::io
