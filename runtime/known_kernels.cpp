#include "runtime/known_kernels.hpp"

#include <fstream>
#include <sstream>
#include <utility>

#include "runtime/cache_file.hpp"
#include "runtime/kernel.hpp"

namespace ecir {
namespace {

/// FNV-1a.
class Hash {
public:
    void add(std::span<const std::byte> bytes) {
        for (const std::byte byte : bytes) {
            value_ = (value_ ^ std::to_integer<uint64_t>(byte)) * 0x100000001B3ULL;
        }
    }
    [[nodiscard]] uint64_t value() const { return value_; }

private:
    uint64_t value_ = 0xCBF29CE484222325ULL;
};

} // namespace

KnownKernels::KnownKernels(std::string file) : file_(std::move(file)) {
    std::ifstream in(file_);
    uint64_t hash = 0;
    while (in >> std::hex >> hash) {
        hashes_.insert(hash);
    }
}

bool KnownKernels::add(std::string_view shader, std::span<const uint32_t> constants) {
    if (file_.empty()) {
        return false;
    }
    Hash hash;
    hash.add(std::as_bytes(embedded_shader(shader)));
    hash.add(std::as_bytes(constants));
    const bool fresh = hashes_.insert(hash.value()).second;
    fresh_ += fresh ? 1 : 0;
    return fresh;
}

void KnownKernels::save() const {
    if (fresh_ == 0) {
        return;
    }
    std::ostringstream text;
    for (const uint64_t hash : hashes_) {
        text << std::hex << hash << '\n';
    }
    write_cache(file_, text.str());
}

} // namespace ecir
