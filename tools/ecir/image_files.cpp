#include "tools/ecir/image_files.hpp"

#include <algorithm>
#include <array>
#include <string>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::cli {

namespace fs = std::filesystem;

std::vector<fs::path> image_files(const fs::path& folder, bool below) {
    constexpr std::array known{".png", ".jpg", ".jpeg", ".tif", ".tiff"};
    std::vector<fs::path> files;
    const auto keep = [&](const fs::directory_entry& entry) {
        const std::string extension = io::lower_extension(entry.path());
        if (std::find(known.begin(), known.end(), extension) != known.end() &&
            entry.is_regular_file()) {
            files.push_back(entry.path());
        }
    };
    try {
        if (below) {
            for (const auto& entry : fs::recursive_directory_iterator(folder)) {
                keep(entry);
            }
        } else {
            for (const auto& entry : fs::directory_iterator(folder)) {
                keep(entry);
            }
        }
    } catch (const fs::filesystem_error& error) {
        throw Error(ExitCode::bad_input,
                    folder.string() + ": cannot be listed: " + error.code().message());
    }
    std::sort(files.begin(), files.end());
    return files;
}

} // namespace ecir::cli
