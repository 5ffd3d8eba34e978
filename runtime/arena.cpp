#include "runtime/arena.hpp"

#include <algorithm>
#include <numeric>

namespace ecir {

ArenaPlan plan_arena(const std::vector<Lifetime>& blocks, uint64_t alignment) {
    std::vector<size_t> order(blocks.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(order,
                             [&](size_t a, size_t b) { return blocks[a].bytes > blocks[b].bytes; });

    ArenaPlan plan;
    plan.offsets.resize(blocks.size());
    std::vector<size_t> placed;
    for (const size_t index : order) {
        const Lifetime& block = blocks[index];
        std::vector<size_t> rivals;
        for (const size_t other : placed) {
            if (blocks[other].first <= block.last && block.first <= blocks[other].last) {
                rivals.push_back(other);
            }
        }
        std::ranges::sort(rivals,
                          [&](size_t a, size_t b) { return plan.offsets[a] < plan.offsets[b]; });
        uint64_t offset = 0;
        for (const size_t other : rivals) {
            if (offset + block.bytes <= plan.offsets[other]) {
                break;
            }
            const uint64_t end = plan.offsets[other] + blocks[other].bytes;
            offset = std::max(offset, (end + alignment - 1) / alignment * alignment);
        }
        plan.offsets[index] = offset;
        plan.bytes = std::max(plan.bytes, offset + block.bytes);
        placed.push_back(index);
    }
    return plan;
}

} // namespace ecir
