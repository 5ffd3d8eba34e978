#include "tools/io/event_file.hpp"

#include <algorithm>
#include <array>
#include <new>
#include <string>

#include "runtime/error.hpp"
#include "tools/io/aedat4.hpp"
#include "tools/io/event_formats.hpp"
#include "tools/io/file.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

namespace {

enum class Format { hdf5, text, aedat4, prophesee, unknown };

constexpr size_t start_size = 4096;

/// The signature lies at 0 or, behind a block of the user's, at 512, 1024, 2048, ...
bool has_hdf5_signature(std::span<const uint8_t> start) {
    constexpr std::array<uint8_t, 8> signature = {0x89, 'H', 'D', 'F', '\r', '\n', 0x1a, '\n'};
    for (size_t at = 0; at + signature.size() <= start.size(); at = at == 0 ? 512 : 2 * at) {
        if (std::equal(signature.begin(), signature.end(), start.begin() + static_cast<long>(at))) {
            return true;
        }
    }
    return false;
}

bool is_plain_text(std::span<const uint8_t> start) {
    return std::ranges::all_of(start, [](uint8_t c) {
        return (c >= 0x20 && c != 0x7f) || c == '\n' || c == '\r' || c == '\t';
    });
}

Format format_of(std::span<const uint8_t> start) {
    if (has_hdf5_signature(start)) {
        return Format::hdf5;
    }
    if (is_aedat4(start)) {
        return Format::aedat4;
    }
    if (is_prophesee(start)) {
        return Format::prophesee;
    }
    return is_plain_text(start) ? Format::text : Format::unknown;
}

const char* name_of(Format format) {
    switch (format) {
    case Format::hdf5:
        return "HDF5";
    case Format::text:
        return "text";
    case Format::aedat4:
        return "AEDAT 4";
    case Format::prophesee:
        return "Prophesee RAW or DAT";
    case Format::unknown:
        break;
    }
    return "unknown";
}

} // namespace

std::unique_ptr<EventStream> open_events(const fs::path& path) {
    std::error_code problem;
    if (fs::is_fifo(path, problem)) {
        throw Error(ExitCode::bad_input, path.string() + ": is a pipe, and events are read more "
                                                         "than once; give a file");
    }
    switch (format_of(read_start(path, start_size))) {
    case Format::hdf5:
        return open_hdf5_events(path);
    case Format::text:
        return open_text_events(path);
    case Format::aedat4:
        return open_aedat4_events(path);
    case Format::prophesee:
        return open_prophesee_events(path);
    case Format::unknown:
        break;
    }
    throw Error(
        ExitCode::bad_input,
        path.string() +
            ": not an events file: neither HDF5, AEDAT 4, Prophesee's RAW or DAT, nor text; "
            "convert the recording to HDF5 (/events/t, x, y, p) or text (t x y p a line)");
}

EventSummary summarize_events(const fs::path& path) {
    const auto stream = open_events(path);
    EventSummary summary{name_of(format_of(read_start(path, start_size))),
                         stream->width(),
                         stream->height(),
                         0,
                         0,
                         stream->span()};
    for (bool more = true; more;) {
        Events block;
        more = stream->read(block); // the end may come with the last events
        summary.events += block.size();
        summary.positive += static_cast<size_t>(std::ranges::count(block.p, 1));
    }
    return summary;
}

EventFile read_events(const fs::path& path) {
    const auto stream = open_events(path);
    EventFile file{{}, stream->width(), stream->height()};
    try {
        while (stream->read(file.events)) {
        }
    } catch (const std::bad_alloc&) {
        throw Error(ExitCode::resources, path.string() + ": not enough memory for more than " +
                                             std::to_string(stream->position()) +
                                             " events; cut the recording into parts");
    }
    return file;
}

bool holds_events(const fs::path& path) {
    const auto start = read_start(path, start_size);
    switch (format_of(start)) {
    case Format::hdf5:
        return hdf5_holds_events(path);
    case Format::text:
        return text_holds_events(start);
    case Format::aedat4:
    case Format::prophesee:
        return true;
    case Format::unknown:
        break;
    }
    return false;
}

void check_inside(const EventView& events, int width, int height, const fs::path& path,
                  size_t first) {
    for (size_t i = 0; i < events.size(); ++i) {
        if (events.x[i] >= width || events.y[i] >= height) {
            throw Error(ExitCode::bad_input,
                        path.string() + ": event " + std::to_string(first + i) +
                            " at x = " + std::to_string(events.x[i]) +
                            ", y = " + std::to_string(events.y[i]) + " lies outside the image of " +
                            std::to_string(width) + " x " + std::to_string(height) +
                            "; give the image and the events of one sensor, x being the column");
        }
    }
}

void fail_unsorted(const fs::path& path, const std::string& place, int64_t before, int64_t time) {
    throw Error(ExitCode::bad_input, path.string() + ": times go back at " + place + ": " +
                                         std::to_string(time) + " us after " +
                                         std::to_string(before) + " us; sort the events by time");
}

} // namespace ecir::io
