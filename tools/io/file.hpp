#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <initializer_list>
#include <span>
#include <string>
#include <vector>

#include "runtime/error.hpp"

namespace ecir::io {

/// The Error for a failed system call: exit 5 where space ran out (ENOSPC, EDQUOT, EFBIG) or
/// memory did, else exit 3. `action` is what was tried, such as "cannot write".
Error system_error(int error_number, const std::filesystem::path& path, const std::string& action);

/// The whole file. Throws Error(bad_input) naming the file when it cannot be read.
std::vector<uint8_t> read_file(const std::filesystem::path& path);

/// The first bytes, at most `count`. Errors as for read_file.
std::vector<uint8_t> read_start(const std::filesystem::path& path, size_t count);

/// A file read at any place.
class FileReader {
public:
    /// Errors as for read_file.
    explicit FileReader(std::filesystem::path path);
    ~FileReader();
    FileReader(const FileReader&) = delete;
    FileReader& operator=(const FileReader&) = delete;
    [[nodiscard]] const std::filesystem::path& path() const { return path_; }
    [[nodiscard]] int64_t size() const { return size_; }
    /// From byte `offset` on, as many as there are; returns how many.
    [[nodiscard]] size_t read(int64_t offset, std::span<uint8_t> bytes) const;

private:
    std::filesystem::path path_;
    int descriptor_;
    int64_t size_ = 0;
};

/// A file written part by part in place of what it held. Every write is checked, so a full disk is
/// an Error(resources); a regular file that was not closed is removed.
class FileWriter {
public:
    explicit FileWriter(std::filesystem::path path);
    ~FileWriter();
    FileWriter(const FileWriter&) = delete;
    FileWriter& operator=(const FileWriter&) = delete;
    void write(std::span<const uint8_t> bytes);
    void close();

private:
    std::filesystem::path path_;
    int descriptor_;
    bool regular_ = false;
};

/// Writes the parts one after another as FileWriter does.
void write_file(const std::filesystem::path& path,
                std::initializer_list<std::span<const uint8_t>> parts);

/// Throws Error(resources) when an existing file cannot grow, which tells of a full disk where a
/// library hides that its writes failed. Leaves the file as it is.
void check_can_grow(const std::filesystem::path& path);

/// The extension in lower case, with its dot.
std::string lower_extension(const std::filesystem::path& path);

/// Whether two paths name one existing thing or the first lies within the second, links resolved.
bool lies_within(const std::filesystem::path& inner, const std::filesystem::path& outer);

} // namespace ecir::io
