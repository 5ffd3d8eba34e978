#include "tools/stability/weights_copy.hpp"

#include <bit>
#include <cstdint>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <span>
#include <unistd.h>
#include <vector>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::stability {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kExtension = ".safetensors";

fs::path temporary_file() {
    std::string name = (fs::temp_directory_path() / "ecir-stability-XXXXXX").string();
    name += kExtension;
    const int file = ::mkstemps(name.data(), static_cast<int>(kExtension.size()));
    if (file < 0) {
        throw Error(ExitCode::resources, "cannot make a file in " +
                                             fs::temp_directory_path().string() +
                                             "; set TMPDIR to a folder that can be written");
    }
    ::close(file);
    return name;
}

std::span<const uint8_t> bytes(const auto& values) {
    return {reinterpret_cast<const uint8_t*>(values.data()),
            values.size() * sizeof(*values.data())};
}

} // namespace

WeightsCopy::WeightsCopy(const SafeTensors& weights,
                         const std::function<float(const std::string&, float)>& change)
    : path_(temporary_file()) {
    nlohmann::json header;
    header["__metadata__"] = weights.metadata();
    std::vector<float> values;
    for (const auto& [name, entry] : weights.tensors()) {
        const size_t begin = values.size();
        for (const float value : entry.values) {
            values.push_back(change(name, value));
        }
        header[name] = {{"dtype", "F32"},
                        {"shape", entry.shape},
                        {"data_offsets", {4 * begin, 4 * values.size()}}};
    }
    std::string text = header.dump();
    text.resize((text.size() + 7) / 8 * 8, ' ');
    const std::vector<uint64_t> length = {text.size()};
    static_assert(std::endian::native == std::endian::little); // as the format is
    io::write_file(path_, {bytes(length), bytes(text), bytes(values)});
}

WeightsCopy::~WeightsCopy() {
    std::error_code ignored;
    fs::remove(path_, ignored);
}

} // namespace ecir::stability
