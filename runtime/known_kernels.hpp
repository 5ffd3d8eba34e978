#pragma once
#include <cstddef>
#include <cstdint>
#include <set>
#include <span>
#include <string>
#include <string_view>

namespace ecir {

/// So many fresh kernels take a CPU driver seconds to compile.
constexpr size_t kManyFreshKernels = 8;

/// Which kernels earlier runs have made on a device, kept in a file of the cache folder: what is
/// not among them the driver has to compile.
class KnownKernels {
public:
    /// Reads the file; one that is missing or damaged holds none. An empty name: nothing is known
    /// and nothing counts as fresh.
    explicit KnownKernels(std::string file);

    /// Notes a kernel that is made now: a shader with its SPIR-V and specialization constants.
    /// Returns whether no earlier run has made it.
    bool add(std::string_view shader, std::span<const uint32_t> constants);
    /// How many of those noted no earlier run has made.
    [[nodiscard]] size_t fresh() const { return fresh_; }
    /// Writes the file where there is something new. Failing is no error, as for all caches.
    void save() const;

private:
    std::string file_;
    std::set<uint64_t> hashes_;
    size_t fresh_ = 0;
};

} // namespace ecir
