#include "weights/safetensors.hpp"

#include <bit>
#include <charconv>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "runtime/error.hpp"

namespace ecir {
namespace {

using nlohmann::json;

std::string shape_text(const std::vector<uint32_t>& shape) {
    std::string text = "[";
    for (const uint32_t size : shape) {
        text += (text.size() > 1 ? ", " : "") + std::to_string(size);
    }
    return text + "]";
}

} // namespace

float half_to_float(uint16_t half) {
    const uint32_t sign = uint32_t{half} >> 15 << 31;
    const uint32_t exponent = half >> 10 & 31U;
    const uint32_t mantissa = half & 1023U;
    if (exponent == 0) { // zero and subnormals: mantissa times 2^-24
        const float value = static_cast<float>(mantissa) * 0x1p-24F;
        return sign != 0 ? -value : value;
    }
    const uint32_t wide = exponent == 31 ? 255 : exponent + 112;
    return std::bit_cast<float>(sign | wide << 23 | mantissa << 13);
}

void SafeTensors::fail(const std::string& what) const {
    throw Error(ExitCode::bad_input, "weights file " + path_.string() + ": " + what);
}

SafeTensors::SafeTensors(const std::filesystem::path& path) : path_(path) {
    std::ifstream in(path, std::ios::binary);
    if (!in || std::filesystem::is_directory(path)) {
        fail("cannot be opened; is the path right?");
    }
    const std::vector<char> file{std::istreambuf_iterator<char>(in),
                                 std::istreambuf_iterator<char>()};
    uint64_t header_bytes = 0;
    if (file.size() < sizeof(header_bytes)) {
        fail("is too short to be a safetensors file (" + std::to_string(file.size()) + " bytes)");
    }
    std::memcpy(&header_bytes, file.data(), sizeof(header_bytes));
    if (header_bytes > file.size() - sizeof(header_bytes)) {
        fail("is not a safetensors file, or is truncated: its header claims " +
             std::to_string(header_bytes) + " bytes, the file has " + std::to_string(file.size()));
    }
    const char* begin = file.data() + sizeof(header_bytes);
    const json header = json::parse(begin, begin + header_bytes, nullptr, false);
    if (!header.is_object()) {
        fail("its header is not a JSON object; it is not a safetensors file or is damaged");
    }
    const char* data = begin + header_bytes;
    const uint64_t data_bytes = file.size() - sizeof(header_bytes) - header_bytes;

    for (const auto& [name, item] : header.items()) {
        if (name == "__metadata__") {
            for (const auto& [key, value] : item.items()) {
                if (!value.is_string()) {
                    fail("metadata '" + key + "' is not a string");
                }
                metadata_[key] = value.get<std::string>();
            }
            continue;
        }
        const std::string where = "tensor '" + name + "' ";
        const bool whole = item.is_object() && item.contains("dtype") &&
                           item["dtype"].is_string() && item.contains("shape") &&
                           item["shape"].is_array() && item.contains("data_offsets") &&
                           item["data_offsets"].is_array() && item["data_offsets"].size() == 2 &&
                           item["data_offsets"][0].is_number_unsigned() &&
                           item["data_offsets"][1].is_number_unsigned();
        if (!whole) {
            fail(where + "lacks its dtype, shape or data_offsets");
        }
        const std::string dtype = item["dtype"];
        if (dtype != "F32" && dtype != "F16") {
            fail(where + "has dtype " + dtype + "; F32 and F16 are supported");
        }
        Entry entry;
        uint64_t count = 1;
        for (const json& size : item["shape"]) {
            if (!size.is_number_unsigned() || size.get<uint64_t>() > UINT32_MAX ||
                (count *= size.get<uint64_t>()) > file.size()) {
                fail(where + "has an impossible shape " + item["shape"].dump());
            }
            entry.shape.push_back(size.get<uint32_t>());
        }
        const uint64_t first = item["data_offsets"][0];
        const uint64_t last = item["data_offsets"][1];
        const uint64_t element = dtype == "F32" ? 4 : 2;
        if (first > last || last > data_bytes) {
            fail(where + "has data offsets " + item["data_offsets"].dump() +
                 ", but the file holds " + std::to_string(data_bytes) +
                 " bytes of data; is it truncated?");
        }
        if (last - first != count * element) {
            fail(where + "has shape " + shape_text(entry.shape) + " and dtype " + dtype + ", but " +
                 std::to_string(last - first) + " bytes");
        }
        entry.values.resize(count);
        if (dtype == "F32") {
            std::memcpy(entry.values.data(), data + first, last - first);
        } else {
            for (uint64_t i = 0; i < count; ++i) {
                uint16_t half = 0;
                std::memcpy(&half, data + first + i * 2, 2);
                entry.values[i] = half_to_float(half);
            }
        }
        tensors_.emplace(name, std::move(entry));
    }
}

std::string SafeTensors::meta(const std::string& key) const {
    const auto found = metadata_.find(key);
    if (found == metadata_.end()) {
        fail("its metadata lacks '" + key + "'");
    }
    return found->second;
}

std::string SafeTensors::meta(const std::string& key, const std::string& fallback) const {
    const auto found = metadata_.find(key);
    return found == metadata_.end() ? fallback : found->second;
}

uint32_t SafeTensors::meta_count(const std::string& key, uint32_t low, uint32_t high) const {
    const std::string text = meta(key);
    uint32_t value = 0;
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc{} || stop != end || value < low || value > high) {
        fail("metadata '" + key + "' is '" + text + "'; it must be a whole number from " +
             std::to_string(low) + " to " + std::to_string(high));
    }
    return value;
}

const SafeTensors::Entry& SafeTensors::get(const std::string& name) const {
    const auto found = tensors_.find(name);
    if (found == tensors_.end()) {
        fail("lacks the tensor '" + name + "'");
    }
    return found->second;
}

const std::vector<float>& SafeTensors::get(const std::string& name,
                                           const std::vector<uint32_t>& shape) const {
    const Entry& entry = get(name);
    if (entry.shape != shape) {
        fail("tensor '" + name + "' has shape " + shape_text(entry.shape) + ", the network needs " +
             shape_text(shape));
    }
    return entry.values;
}

} // namespace ecir
