#include "runtime/cache_file.hpp"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "runtime/device.hpp"

namespace ecir {

std::string cache_file(const DeviceInfo& info, std::string_view ending) {
    namespace fs = std::filesystem;
    fs::path folder;
    if (const char* own = std::getenv("ECIR_CACHE_DIR")) {
        folder = own;
    } else if (const char* xdg = std::getenv("XDG_CACHE_HOME")) {
        folder = fs::path(xdg) / "ecir";
    } else if (const char* home = std::getenv("HOME")) {
        folder = fs::path(home) / ".cache" / "ecir";
    }
    if (folder.empty()) {
        return {};
    }
    std::string name = info.name + "-" + info.driver;
    std::ranges::replace_if(
        name, [](unsigned char c) { return std::isalnum(c) == 0 && c != '.' && c != '-'; }, '_');
    return (folder / name).string() + std::string(ending);
}

void write_cache(const std::string& file, std::span<const char> data) {
    std::error_code ignored;
    std::filesystem::create_directories(std::filesystem::path(file).parent_path(), ignored);
    // Another process, or a twin of the device, may be writing the same file.
    static std::atomic<unsigned> written = 0;
    const std::string partial =
        file + "." + std::to_string(getpid()) + "-" + std::to_string(written++) + ".partial";
    if (std::ofstream out{partial, std::ios::binary}) {
        out.write(data.data(), static_cast<std::streamsize>(data.size()));
        out.close();
        if (out) {
            std::filesystem::rename(partial, file, ignored);
        } else {
            std::filesystem::remove(partial, ignored);
        }
    }
}

} // namespace ecir
