#include "tools/io/npy.hpp"

#include <bit>
#include <charconv>
#include <cstring>
#include <string>
#include <string_view>

#include "runtime/error.hpp"
#include "tools/io/file.hpp"

namespace ecir::io {

namespace fs = std::filesystem;

static_assert(std::endian::native == std::endian::little,
              "arrays are copied as they lie in the file, little-endian");

namespace {

constexpr std::string_view magic = "\x93NUMPY";
constexpr size_t max_dimensions = 32; // NumPy's own limit

[[noreturn]] void fail(const fs::path& path, const std::string& what, const std::string& remedy) {
    throw Error(ExitCode::bad_input, path.string() + ": " + what + "; " + remedy);
}

struct Header {
    std::string_view text; ///< the dictionary
    size_t data = 0;       ///< where the values start
};

Header find_header(const fs::path& path, std::span<const uint8_t> bytes) {
    if (bytes.size() < 10 || std::memcmp(bytes.data(), magic.data(), magic.size()) != 0) {
        fail(path, "not a NumPy array", "give a file written by numpy.save");
    }
    // From version 2.0 on the header's length takes four bytes instead of two.
    const bool wide = bytes[6] >= 2;
    const size_t start = wide ? 12 : 10;
    size_t length = bytes[8] + (size_t{bytes[9]} << 8U);
    if (wide && bytes.size() >= start) {
        length += (size_t{bytes[10]} << 16U) + (size_t{bytes[11]} << 24U);
    }
    if (bytes.size() < start || length > bytes.size() - start) {
        fail(path, "truncated in the header", "copy the file again");
    }
    return {{reinterpret_cast<const char*>(bytes.data()) + start, length}, start + length};
}

/// The text after `'key':` with blanks skipped.
std::string_view entry(const fs::path& path, std::string_view header, const std::string& key) {
    const size_t at = header.find("'" + key + "'");
    const size_t colon = at == std::string_view::npos ? at : header.find(':', at);
    const size_t value =
        colon == std::string_view::npos ? colon : header.find_first_not_of(' ', colon + 1);
    if (value == std::string_view::npos) {
        fail(path, "the header has no '" + key + "'", "write the file again with numpy.save");
    }
    return header.substr(value);
}

std::vector<size_t> parse_shape(const fs::path& path, std::string_view text) {
    const size_t close = text.find(')');
    if (!text.starts_with('(') || close == std::string_view::npos) {
        fail(path, "the header's 'shape' is not a tuple", "write the file again with numpy.save");
    }
    std::vector<size_t> shape;
    const char* at = text.data() + 1;
    const char* end = text.data() + close;
    while (at != end) {
        if (*at == ' ' || *at == ',') {
            ++at;
            continue;
        }
        size_t length = 0;
        const auto [next, problem] = std::from_chars(at, end, length);
        if (problem != std::errc() || shape.size() == max_dimensions) {
            fail(path, "the header's 'shape' is malformed", "write the file again with numpy.save");
        }
        shape.push_back(length);
        at = next;
    }
    return shape;
}

size_t count_values(const fs::path& path, const std::vector<size_t>& shape) {
    size_t count = 1;
    for (const size_t length : shape) {
        if (__builtin_mul_overflow(count, length, &count)) {
            fail(path, "the header's 'shape' is too large", "write the file again with numpy.save");
        }
    }
    return count;
}

/// As in Python, without the parentheses.
std::string tuple_text(std::span<const size_t> shape) {
    std::string text;
    for (const size_t length : shape) {
        text += (text.empty() ? "" : ", ") + std::to_string(length);
    }
    return shape.size() == 1 ? text + "," : text;
}

template <class Stored>
std::vector<float> to_floats(const fs::path& path, std::span<const uint8_t> data, size_t count) {
    if (count != data.size() / sizeof(Stored) || data.size() % sizeof(Stored) != 0) {
        fail(path,
             "the shape asks for " + std::to_string(count) + " values of " +
                 std::to_string(sizeof(Stored)) + " bytes, the file has " +
                 std::to_string(data.size()) + " bytes of them",
             "it is truncated or damaged: copy it again");
    }
    std::vector<float> values(count);
    for (size_t i = 0; i < count; ++i) {
        Stored stored;
        std::memcpy(&stored, data.data() + i * sizeof(Stored), sizeof(Stored));
        values[i] = static_cast<float>(stored);
    }
    return values;
}

} // namespace

Array read_npy(const fs::path& path, bool* integer) {
    const std::vector<uint8_t> bytes = read_file(path);
    const Header header = find_header(path, bytes);
    Array array;
    array.shape = parse_shape(path, entry(path, header.text, "shape"));
    const size_t count = count_values(path, array.shape);
    if (array.shape.size() > 1 && entry(path, header.text, "fortran_order").starts_with("True")) {
        fail(path, "the array is in Fortran order", "save numpy.ascontiguousarray of it");
    }
    const std::string_view quoted = entry(path, header.text, "descr");
    const std::string_view type = quoted.substr(0, quoted.find('\'', 1) + 1);
    const auto data = std::span<const uint8_t>(bytes).subspan(header.data);
    if (type == "'<f4'") {
        array.values = to_floats<float>(path, data, count);
    } else if (type == "'<f8'") {
        array.values = to_floats<double>(path, data, count);
    } else if (type == "'|u1'") {
        array.values = to_floats<uint8_t>(path, data, count);
    } else if (type == "'<u2'") {
        array.values = to_floats<uint16_t>(path, data, count);
    } else {
        fail(path, "values of type " + std::string(type) + " are not taken",
             "convert the array to float32 (or '<f8', '|u1', '<u2')");
    }
    if (integer != nullptr) {
        *integer = type == "'|u1'" || type == "'<u2'";
    }
    return array;
}

NpyWriter::NpyWriter(const fs::path& path, std::span<const size_t> shape)
    : path_(path), count_(count_values(path, {shape.begin(), shape.end()})), file_(path) {
    const std::string header =
        "{'descr': '<f4', 'fortran_order': False, 'shape': (" + tuple_text(shape) + "), }";
    // The values start at a multiple of 64 bytes; the header ends with a newline.
    const size_t start = magic.size() + 4;
    const size_t padding = 63 - (start + header.size()) % 64;
    const size_t length = header.size() + padding + 1;
    std::string front(magic);
    front += '\x01';
    front += '\x00';
    front += static_cast<char>(length & 0xffU);
    front += static_cast<char>(length >> 8U);
    front += header + std::string(padding, ' ') + '\n';
    file_.write({reinterpret_cast<const uint8_t*>(front.data()), front.size()});
}

void NpyWriter::add(std::span<const float> values) {
    file_.write({reinterpret_cast<const uint8_t*>(values.data()), values.size_bytes()});
    written_ += values.size();
}

void NpyWriter::close() {
    if (written_ != count_) {
        fail(path_,
             "cannot write " + std::to_string(written_) + " values as " + std::to_string(count_),
             "give as many values as the shape has");
    }
    file_.close();
}

void write_npy(const fs::path& path, std::span<const size_t> shape, std::span<const float> values) {
    if (count_values(path, {shape.begin(), shape.end()}) != values.size()) {
        fail(path,
             "cannot write " + std::to_string(values.size()) + " values as (" + tuple_text(shape) +
                 ")",
             "give as many values as the shape has");
    }
    NpyWriter writer(path, shape);
    writer.add(values);
    writer.close();
}

} // namespace ecir::io
