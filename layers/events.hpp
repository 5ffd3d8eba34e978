#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace ecir {

/// A time window on the events' clock, microseconds, both ends included.
struct Exposure {
    int64_t start = 0;
    int64_t end = 0;
    [[nodiscard]] int64_t duration() const { return end - start; }
};

/// Events as four arrays of one length, sorted by time. Nothing is copied.
struct EventView {
    std::span<const int64_t> t;  ///< microseconds, any origin (up to 1.6e15 and beyond)
    std::span<const uint16_t> x; ///< column, 0 at the left
    std::span<const uint16_t> y; ///< row, 0 at the top
    std::span<const uint8_t> p;  ///< 1 brighter, 0 darker
    [[nodiscard]] size_t size() const { return t.size(); }
    [[nodiscard]] EventView subview(size_t first, size_t count) const {
        return {t.subspan(first, count), x.subspan(first, count), y.subspan(first, count),
                p.subspan(first, count)};
    }
};

/// Events that own their memory.
struct Events {
    std::vector<int64_t> t;
    std::vector<uint16_t> x;
    std::vector<uint16_t> y;
    std::vector<uint8_t> p;
    [[nodiscard]] size_t size() const { return t.size(); }
    [[nodiscard]] EventView view() const { return {t, x, y, p}; }
    void push_back(int64_t time, uint16_t column, uint16_t row, uint8_t polarity) {
        t.push_back(time);
        x.push_back(column);
        y.push_back(row);
        p.push_back(polarity);
    }
};

/// The events with exposure.start <= t <= exposure.end; `events` must be sorted by time.
EventView window(const EventView& events, const Exposure& exposure);

/// How many of the events each pixel has, [height][width]. They must lie inside the image.
std::vector<uint32_t> event_counts(const EventView& events, uint32_t width, uint32_t height);

} // namespace ecir
