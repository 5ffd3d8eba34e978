#pragma once
#include <cstdint>

#include "tools/io/recording.hpp"

namespace ecir::io {

// What recording.cpp chooses from.

/// The largest time of an exposure, microseconds either way: keeps durations within int64.
inline constexpr int64_t max_exposure_time = 4'000'000'000'000'000'000;

/// Whether a file of iniVation's AEDAT 4 holds frames.
bool aedat4_holds_frames(const std::filesystem::path& path);

/// iniVation's AEDAT 4 with frames and events.
Recording open_aedat4_recording(const std::filesystem::path& path);

} // namespace ecir::io
