#pragma once
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace ecir {

/// A safetensors file in memory: named float32 tensors (float16 ones widened) and the metadata.
///
/// Every number of the file is checked before it is used; a file that is truncated, overlaps, has a
/// dtype other than F32 or F16, or lacks what is asked for throws Error(bad_input) naming the file
/// and the tensor.
class SafeTensors {
public:
    struct Entry {
        std::vector<uint32_t> shape;
        std::vector<float> values; ///< C order
    };

    explicit SafeTensors(const std::filesystem::path& path);

    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] const std::map<std::string, std::string>& metadata() const { return metadata_; }
    [[nodiscard]] const std::map<std::string, Entry>& tensors() const { return tensors_; }

    /// A metadata entry, or `fallback`; the one-argument form throws when it is missing.
    [[nodiscard]] std::string meta(const std::string& key) const;
    [[nodiscard]] std::string meta(const std::string& key, const std::string& fallback) const;
    /// A metadata entry that must be a whole number within [low, high].
    [[nodiscard]] uint32_t meta_count(const std::string& key, uint32_t low, uint32_t high) const;

    [[nodiscard]] bool has(const std::string& name) const { return tensors_.contains(name); }
    [[nodiscard]] const Entry& get(const std::string& name) const;
    /// The tensor, which must have this shape.
    [[nodiscard]] const std::vector<float>& get(const std::string& name,
                                                const std::vector<uint32_t>& shape) const;

private:
    [[noreturn]] void fail(const std::string& what) const;

    std::filesystem::path path_;
    std::map<std::string, std::string> metadata_;
    std::map<std::string, Entry> tensors_;
};

/// IEEE 754 binary16 to float.
float half_to_float(uint16_t half);

} // namespace ecir
