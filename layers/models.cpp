#include <algorithm>

#include "layers/deblur.hpp"
#include "runtime/error.hpp"

// Where shipped models are found.

namespace ecir {
namespace {

namespace fs = std::filesystem;

constexpr const char* kExtension = ".safetensors";

std::vector<fs::path> weight_folders() {
    std::vector<fs::path> folders;
    std::error_code error;
    const fs::path program = fs::read_symlink("/proc/self/exe", error);
    if (!error) { // an installation may have been moved as a whole
        folders.push_back(program.parent_path().parent_path() / "share" / "ecir" / "weights");
    }
    folders.emplace_back(ECIR_INSTALLED_WEIGHTS);
    folders.emplace_back(ECIR_SOURCE_WEIGHTS);
    return folders;
}

} // namespace

std::vector<std::string> model_names() {
    std::vector<std::string> names;
    for (const fs::path& folder : weight_folders()) {
        std::error_code error;
        for (const auto& entry : fs::directory_iterator(folder, error)) {
            if (entry.path().extension() == kExtension) {
                names.push_back(entry.path().stem().string());
            }
        }
    }
    std::ranges::sort(names);
    names.erase(std::unique(names.begin(), names.end()), names.end());
    names.insert(names.begin(), "edi");
    return names;
}

fs::path find_model(const std::string& name) {
    if (fs::path(name).extension() == kExtension) {
        return name;
    }
    std::string places;
    for (const fs::path& folder : weight_folders()) {
        const fs::path file = folder / (name + kExtension);
        std::error_code error;
        if (fs::is_regular_file(file, error)) {
            return file;
        }
        places += (places.empty() ? " " : ", ") + folder.string();
    }
    std::string known;
    for (const std::string& other : model_names()) {
        known += (known.empty() ? "" : ", ") + other;
    }
    throw Error(ExitCode::bad_input, "no model '" + name + "'; there are: " + known +
                                         " (or give the path of a .safetensors file); looked in" +
                                         places);
}

} // namespace ecir
