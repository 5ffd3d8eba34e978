#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "tools/io/event_file.hpp"

namespace ecir::io {

// What event_file.cpp chooses from; each format has a file of its own.

/// The largest time taken, in microseconds either way: leaves room for sums in int64.
inline constexpr int64_t max_event_time = 4'000'000'000'000'000'000;

/// DSEC's /events/{t,x,y,p} and /t_offset in any integer type, or /raw_events/{t,x,y,p}, where
/// floating-point times are seconds. Errors as for read_events.
EventFile read_hdf5_events(const std::filesystem::path& path);

/// Whether an HDF5 file has one of the layouts above; a damaged file counts as having one.
bool hdf5_holds_events(const std::filesystem::path& path);

/// Whether a file that starts with `start` is of the text form: its first line that is neither
/// blank nor a comment (#) has four numbers, or two integers (the sensor's size).
bool text_holds_events(std::span<const uint8_t> start);

/// Errors as for read_events.
EventFile read_text_events(const std::filesystem::path& path);

/// The Error for times that go back at `place` ("event 7" or "line 8"); in microseconds.
[[noreturn]] void fail_unsorted(const std::filesystem::path& path, const std::string& place,
                                int64_t before, int64_t time);

} // namespace ecir::io
