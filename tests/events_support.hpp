#pragma once
#include <algorithm>
#include <doctest/doctest.h>
#include <filesystem>
#include <vector>

#include "tools/io/event_windows.hpp"

namespace ecir::test {

inline bool equal(const EventView& a, const EventView& b) {
    return std::ranges::equal(a.t, b.t) && std::ranges::equal(a.x, b.x) &&
           std::ranges::equal(a.y, b.y) && std::ranges::equal(a.p, b.p);
}

/// A file of these events gives those of each exposure, asked for in this order, however it is
/// read.
inline void check_windows(const std::filesystem::path& path, const Events& events,
                          const std::vector<Exposure>& exposures) {
    CAPTURE(path.string());
    for (const auto reading :
         {io::EventWindows::Reading::whole, io::EventWindows::Reading::sparse}) {
        io::EventWindows windows(path, reading);
        REQUIRE(windows.span().has_value());
        CHECK(windows.span()->first == events.t.front());
        CHECK(windows.span()->last == events.t.back());
        for (const Exposure& exposure : exposures) {
            CAPTURE(exposure.start - events.t.front());
            CAPTURE(exposure.end - events.t.front());
            const EventView expected = window(events.view(), exposure);
            const auto found = windows.read(exposure);
            REQUIRE(equal(found.events, expected));
            if (expected.size() > 0) {
                CHECK(found.first == static_cast<size_t>(expected.t.data() - events.t.data()));
            }
        }
        CHECK_NOTHROW(windows.finish());
    }
}

} // namespace ecir::test
