#pragma once
#include <filesystem>
#include <vector>

namespace ecir::cli {

/// The PNG, JPEG and TIFF files (by extension) in a folder, sorted by name; with `below`, those of
/// its subfolders as well. Throws Error(bad_input) when the folder cannot be listed.
std::vector<std::filesystem::path> image_files(const std::filesystem::path& folder, bool below);

} // namespace ecir::cli
