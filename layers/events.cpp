#include "layers/events.hpp"

#include <algorithm>

namespace ecir {

EventView window(const EventView& events, const Exposure& exposure) {
    const auto first = std::ranges::lower_bound(events.t, exposure.start);
    const auto last = std::ranges::upper_bound(first, events.t.end(), exposure.end);
    return events.subview(static_cast<size_t>(first - events.t.begin()),
                          static_cast<size_t>(last - first));
}

std::vector<uint32_t> event_counts(const EventView& events, uint32_t width, uint32_t height) {
    std::vector<uint32_t> counts(size_t{width} * height);
    for (size_t i = 0; i < events.size(); ++i) {
        ++counts[size_t{events.y[i]} * width + events.x[i]];
    }
    return counts;
}

} // namespace ecir
