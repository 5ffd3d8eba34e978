#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "tools/io/event_file.hpp"

namespace ecir::io {

// What event_file.cpp and event_windows.cpp choose from; each format has a file of its own.

/// The largest time taken, in microseconds either way: leaves room for sums in int64.
inline constexpr int64_t max_event_time = 4'000'000'000'000'000'000;

/// An events file read block by block. Checked, with errors as for read_events(): of what is read
/// everything, of what is passed over on the way the order of the times (text: everything).
class EventStream {
public:
    EventStream() = default;
    virtual ~EventStream() = default;
    EventStream(const EventStream&) = delete;
    EventStream& operator=(const EventStream&) = delete;

    /// Appends the next block of events, maybe none; false at the end of the file, with its last
    /// events or after them.
    virtual bool read(Events& out) = 0;
    /// How many events there are in the file before what read() gives next.
    [[nodiscard]] virtual size_t position() const = 0;
    /// Goes on at or before the first event of `time` or later, past everything between.
    virtual void seek(int64_t time) = 0;
    /// The same without reading everything between, where the format allows that.
    virtual void jump(int64_t time) = 0;
    /// Passes over the rest of the file; what read() gives next is undefined.
    virtual void finish() = 0;
    /// Of the whole file, without passing over it; none where there are no events.
    virtual std::optional<TimeSpan> span() = 0;

    /// Of the sensor, where the file states it.
    [[nodiscard]] virtual std::optional<int> width() const { return std::nullopt; }
    [[nodiscard]] virtual std::optional<int> height() const { return std::nullopt; }
};

/// Opens HDF5 or text, told apart by content. Throws Error(bad_input).
std::unique_ptr<EventStream> open_events(const std::filesystem::path& path);

/// DSEC's /events/{t,x,y,p} and /t_offset in any integer type, or /raw_events/{t,x,y,p}, where
/// floating-point times are seconds.
std::unique_ptr<EventStream> open_hdf5_events(const std::filesystem::path& path);

/// Whether an HDF5 file has one of the layouts above; a damaged file counts as having one.
bool hdf5_holds_events(const std::filesystem::path& path);

/// `t x y p` a line.
std::unique_ptr<EventStream> open_text_events(const std::filesystem::path& path);

/// Whether a file that starts with `start` is of the text form: its first line that is neither
/// blank nor a comment (#) has four numbers, or two integers (the sensor's size).
bool text_holds_events(std::span<const uint8_t> start);

/// iniVation's AEDAT 4. Of what is passed over, the order of the times is what the file's table
/// says.
std::unique_ptr<EventStream> open_aedat4_events(const std::filesystem::path& path);

/// Prophesee's files: RAW with EVT 2.0, 2.1 or 3.0 words, or DAT with contrast events. The times
/// are those of the camera's clock.
std::unique_ptr<EventStream> open_prophesee_events(const std::filesystem::path& path);

/// Whether a file that starts with `start` is one of those: it has their header, lines with %.
bool is_prophesee(std::span<const uint8_t> start);

/// The Error for times that go back at `place` ("event 7" or "line 8"); in microseconds.
[[noreturn]] void fail_unsorted(const std::filesystem::path& path, const std::string& place,
                                int64_t before, int64_t time);

} // namespace ecir::io
