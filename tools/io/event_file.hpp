#pragma once
#include <filesystem>
#include <optional>
#include <string>

#include "layers/events.hpp"

namespace ecir::io {

/// What an events file holds. The sensor size is known only where the file states it.
struct EventFile {
    Events events;
    std::optional<int> width;
    std::optional<int> height;
};

/// Of the first and the last event, microseconds.
struct TimeSpan {
    int64_t first = 0;
    int64_t last = 0;
};

/// Reads HDF5 (DSEC's layout), AEDAT 4, Prophesee's RAW and DAT, or text (`t x y p` a line,
/// seconds), told apart by content. Checked: arrays of one length, times in order, p in {0, 1}
/// (text: also {-1, 1}), numbers finite. Throws Error(bad_input) with file, the first offending
/// index or line, and a remedy.
EventFile read_events(const std::filesystem::path& path);

/// What an events file holds, found by one pass over it in constant memory.
struct EventSummary {
    std::string format; ///< "AEDAT 4"
    std::optional<int> width;
    std::optional<int> height;
    size_t events = 0;
    size_t positive = 0;
    std::optional<TimeSpan> span;
};

/// Errors as for read_events().
EventSummary summarize_events(const std::filesystem::path& path);

/// Whether the content is that of an events file (which may still turn out to be damaged).
/// Throws Error(bad_input) when the file cannot be opened.
bool holds_events(const std::filesystem::path& path);

/// Throws Error(bad_input) naming the first event outside a width x height image; `first` is the
/// number in the file of the first of them.
void check_inside(const EventView& events, int width, int height, const std::filesystem::path& path,
                  size_t first = 0);

/// Writes DSEC's layout with gzip and shuffle.
/// Throws Error(resources) when the disk is full, Error(bad_input) when the folder cannot be
/// written.
void write_events(const std::filesystem::path& path, const EventView& events);

} // namespace ecir::io
