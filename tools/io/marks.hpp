#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <vector>

namespace ecir::io {

/// Places in a file that is read from its start on, for going back: few, whatever its length.
/// Place: has `offset`, bytes from the file's start, and `last`, the time of the last event before.
template <class Place> class Marks {
public:
    /// Remembers a place, unless one is near that was reached before.
    void add(const Place& place) {
        constexpr size_t most = 1024;
        if (!places_.empty() && place.offset < places_.back().offset + spacing_) {
            return;
        }
        if (places_.size() == most) {
            for (size_t i = 0; i < most / 2; ++i) {
                places_[i] = places_[2 * i];
            }
            places_.resize(most / 2);
            spacing_ *= 2;
        }
        places_.push_back(place);
    }

    /// The last place before all events of `time` or later; `start` where there is none.
    [[nodiscard]] Place before(int64_t time, const Place& start) const {
        const auto later = std::ranges::lower_bound(places_, time, {}, &Place::last);
        return later == places_.begin() ? start : *std::prev(later);
    }

private:
    std::vector<Place> places_; ///< ascending
    int64_t spacing_ = int64_t{1} << 22U;
};

} // namespace ecir::io
