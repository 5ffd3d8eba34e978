#include "layers/events.hpp"

#include <algorithm>

namespace ecir {

EventView window(const EventView& events, const Exposure& exposure) {
    const auto first = std::ranges::lower_bound(events.t, exposure.start);
    const auto last = std::ranges::upper_bound(first, events.t.end(), exposure.end);
    return events.subview(static_cast<size_t>(first - events.t.begin()),
                          static_cast<size_t>(last - first));
}

} // namespace ecir
