#pragma once
#include <span>
#include <string>
#include <string_view>

namespace ecir {

struct DeviceInfo;

/// A file of the cache folder that is about a device and its driver, whose name ends in `ending`;
/// empty where there is no such folder. The folder: ECIR_CACHE_DIR (empty: none), else
/// $XDG_CACHE_HOME/ecir, else ~/.cache/ecir.
std::string cache_file(const DeviceInfo& info, std::string_view ending);

/// Replaces a file of the cache folder as a whole, and makes the folder; failing is no error, as
/// for all caches.
void write_cache(const std::string& file, std::span<const char> data);

} // namespace ecir
