#pragma once
#include <cstdint>
#include <filesystem>
#include <span>
#include <vector>

#include "tools/io/file.hpp"

namespace ecir::io {

/// A float32 array in C order.
struct Array {
    std::vector<size_t> shape;
    std::vector<float> values;
};

/// NumPy format 1.0, little-endian. Reading takes f4, f8, u1 and u2 (u1 and u2 stay 0..255 and
/// 0..65535: see `integer`). Errors as for read_image / write_image.
Array read_npy(const std::filesystem::path& path, bool* integer = nullptr);
void write_npy(const std::filesystem::path& path, std::span<const size_t> shape,
               std::span<const float> values);

/// A float32 array written part by part, so that it need not fit into memory.
class NpyWriter {
public:
    NpyWriter(const std::filesystem::path& path, std::span<const size_t> shape);
    /// The next values in C order.
    void add(std::span<const float> values);
    /// Ends the file, which then has as many values as its shape.
    void close();

private:
    std::filesystem::path path_;
    size_t count_;
    size_t written_ = 0;
    FileWriter file_;
};

} // namespace ecir::io
