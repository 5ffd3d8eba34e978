#include "layers/activity.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

namespace ecir {
namespace {

constexpr int64_t kCompanyShare = 16; ///< company comes within this part of the exposure
constexpr double kCertain = 0.6;      ///< share of a cell's pixels that noise never reaches
constexpr double kLeast = 4;          ///< pixels in company beyond what chance makes
constexpr double kDeviations = 4;
constexpr double kQuietShare = 0.1; ///< of the cells, taken as without motion

/// A pixel of the image with one pixel more on every side.
enum Mark : uint8_t { fired = 1, in_company = 2 };

/// What each pixel saw, [height + 2][width + 2].
std::vector<uint8_t> mark_pixels(const EventView& events, const Exposure& exposure, uint32_t width,
                                 uint32_t height) {
    const ptrdiff_t pitch = ptrdiff_t{width} + 2;
    const std::array<ptrdiff_t, 8> neighbours = {-pitch - 1, -pitch,    -pitch + 1, -1,
                                                 1,          pitch - 1, pitch,      pitch + 1};
    const size_t size = static_cast<size_t>(pitch) * (size_t{height} + 2);
    const int64_t within = exposure.duration() / kCompanyShare;
    std::vector<uint8_t> marks(size);
    constexpr int64_t kNever = std::numeric_limits<int64_t>::min() / 2;
    std::vector<int64_t> latest(size, kNever); // since the exposure's start
    for (size_t i = 0; i < events.size(); ++i) {
        const ptrdiff_t at = (ptrdiff_t{events.y[i]} + 1) * pitch + events.x[i] + 1;
        const int64_t time = events.t[i] - exposure.start;
        uint8_t mark = fired;
        for (const ptrdiff_t step : neighbours) {
            const auto other = static_cast<size_t>(at + step);
            if (time - latest[other] <= within) {
                mark |= in_company;
                marks[other] |= in_company;
            }
        }
        marks[static_cast<size_t>(at)] |= mark;
        latest[static_cast<size_t>(at)] = time;
    }
    return marks;
}

struct CellCount {
    uint32_t pixels = 0;
    uint32_t fired = 0;
    uint32_t in_company = 0;
    /// Events a pixel, were they spread by chance.
    [[nodiscard]] double rate() const {
        return -std::log(1 - std::min(kCertain, static_cast<double>(fired) / pixels));
    }
};

std::vector<CellCount> count_cells(const std::vector<uint8_t>& marks, uint32_t columns,
                                   uint32_t width, uint32_t height) {
    const size_t rows = (height + activity_cell - 1) / activity_cell;
    std::vector<CellCount> cells(columns * rows);
    for (uint32_t y = 0; y < height; ++y) {
        const uint8_t* row = marks.data() + (size_t{y} + 1) * (size_t{width} + 2) + 1;
        for (uint32_t x = 0; x < width; ++x) {
            CellCount& cell = cells[size_t{y / activity_cell} * columns + x / activity_cell];
            cell.pixels += 1;
            cell.fired += row[x] & fired;
            cell.in_company += row[x] / in_company;
        }
    }
    return cells;
}

/// The rate that a tenth of the cells stay within.
double quiet_rate(const std::vector<CellCount>& cells) {
    std::vector<double> rates(cells.size());
    std::ranges::transform(cells, rates.begin(), &CellCount::rate);
    const auto tenth =
        rates.begin() + static_cast<ptrdiff_t>(kQuietShare * static_cast<double>(rates.size() - 1));
    std::ranges::nth_element(rates, tenth);
    return *tenth;
}

/// Pixels in company beyond chance, in multiples of what makes a cell active.
double evidence(const CellCount& cell, double quiet) {
    if (cell.fired >= kCertain * cell.pixels) {
        return std::numeric_limits<double>::infinity();
    }
    constexpr double kPlaces = 8 * 2.0 / kCompanyShare; // neighbours, before and after
    const double alone = std::exp(-kPlaces * std::min(cell.rate(), quiet));
    const double chance = cell.fired * (1 - alone);
    // Pixels come into company in pairs, which doubles the variance.
    return (cell.in_company - chance) / (kLeast + kDeviations * std::sqrt(2 * chance));
}

} // namespace

double ActivityMap::share() const {
    return std::accumulate(active.begin(), active.end(), 0.0) / static_cast<double>(active.size());
}

ActivityMap touched_cells(const EventView& events, uint32_t width, uint32_t height) {
    ActivityMap map(width, height);
    for (size_t i = 0; i < events.size(); ++i) {
        map.active[size_t{events.y[i] / activity_cell} * map.columns +
                   events.x[i] / activity_cell] = 1;
    }
    return map;
}

ActivityMap moving_cells(const EventView& events, const Exposure& exposure, uint32_t width,
                         uint32_t height) {
    ActivityMap map(width, height);
    const auto cells =
        count_cells(mark_pixels(events, exposure, width, height), map.columns, width, height);
    const double quiet = quiet_rate(cells);
    std::vector<double> found(cells.size());
    std::ranges::transform(cells, found.begin(),
                           [&](const CellCount& cell) { return evidence(cell, quiet); });
    const auto near_active = [&](uint32_t column, uint32_t row) {
        for (uint32_t r = row - std::min(row, 1U); r < std::min(row + 2, map.rows); ++r) {
            for (uint32_t c = column - std::min(column, 1U); c < std::min(column + 2, map.columns);
                 ++c) {
                if (found[size_t{r} * map.columns + c] >= 1) {
                    return true;
                }
            }
        }
        return false;
    };
    for (uint32_t row = 0; row < map.rows; ++row) {
        for (uint32_t column = 0; column < map.columns; ++column) {
            const size_t at = size_t{row} * map.columns + column;
            map.active[at] =
                found[at] >= 1 || (found[at] >= 0.5 && near_active(column, row)) ? 1 : 0;
        }
    }
    return map;
}

} // namespace ecir
