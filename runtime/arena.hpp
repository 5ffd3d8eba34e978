#pragma once
#include <cstdint>
#include <vector>

namespace ecir {

/// One block of memory wanted from step `first` to step `last`, both included.
struct Lifetime {
    uint64_t bytes;
    uint32_t first;
    uint32_t last;
};

struct ArenaPlan {
    std::vector<uint64_t> offsets; ///< by block
    uint64_t bytes = 0;            ///< of the whole arena
};

/// Places blocks so that two that live at the same time never overlap: the largest first, each at
/// the lowest free offset (a multiple of `alignment`).
ArenaPlan plan_arena(const std::vector<Lifetime>& blocks, uint64_t alignment);

} // namespace ecir
