#include "layers/regions.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

namespace ecir {
namespace {

/// Pixels that a window costs beside its own: launching its kernels, cutting it out.
constexpr size_t kWindowCost = 4096;
/// More groups of cells than this are the whole image: the sensor is full of something.
constexpr size_t kMostGroups = 256;

/// Cells, the right and lower ends excluded.
using CellRect = PixelRect;

CellRect unite(const CellRect& a, const CellRect& b) {
    return {std::min(a.left, b.left), std::min(a.top, b.top), std::max(a.right, b.right),
            std::max(a.bottom, b.bottom)};
}

/// The rectangles around groups of active cells that touch, corners included.
std::vector<CellRect> cell_groups(const ActivityMap& map) {
    std::vector<CellRect> groups;
    std::vector<uint8_t> seen(map.active.size());
    std::vector<std::pair<uint32_t, uint32_t>> open;
    const auto visit = [&](uint32_t column, uint32_t row) {
        uint8_t& here = seen[size_t{row} * map.columns + column];
        if (map.at(column, row) && here == 0) {
            here = 1;
            open.emplace_back(column, row);
        }
    };
    for (uint32_t row = 0; row < map.rows; ++row) {
        for (uint32_t column = 0; column < map.columns; ++column) {
            visit(column, row);
            if (open.empty()) {
                continue;
            }
            CellRect group{column, row, column + 1, row + 1};
            while (!open.empty()) {
                const auto [x, y] = open.back();
                open.pop_back();
                group = unite(group, {x, y, x + 1, y + 1});
                for (uint32_t r = y - std::min(y, 1U); r < std::min(y + 2, map.rows); ++r) {
                    for (uint32_t c = x - std::min(x, 1U); c < std::min(x + 2, map.columns); ++c) {
                        visit(c, r);
                    }
                }
            }
            groups.push_back(group);
        }
    }
    return groups;
}

struct Span {
    uint32_t begin;
    uint32_t end;
};

/// A stretch of a side of the image, grown and aligned as windows are.
Span aligned(Span kept, uint32_t context, uint32_t size) {
    uint32_t begin = (kept.begin - std::min(kept.begin, context)) / window_grid * window_grid;
    const uint32_t needed = std::min(size, kept.end + context) - begin;
    const uint32_t length = (needed + window_step - 1) / window_step * window_step;
    if (begin + length < size) {
        return {begin, begin + length};
    }
    begin = begin / window_step * window_step; // so that few sizes occur at the border, too
    return {begin, size};
}

Window make_window(const CellRect& group, const RegionRule& rule, uint32_t width, uint32_t height) {
    const auto kept = [&](uint32_t begin, uint32_t end, uint32_t size) {
        const uint32_t low = begin * activity_cell;
        return Span{low - std::min(low, rule.fade),
                    std::min(size, end * activity_cell + rule.fade)};
    };
    const Span x = kept(group.left, group.right, width);
    const Span y = kept(group.top, group.bottom, height);
    const Span wide = aligned(x, rule.context, width);
    const Span high = aligned(y, rule.context, height);
    return {{wide.begin, high.begin, wide.end, high.end}, {x.begin, y.begin, x.end, y.end}};
}

/// Unites groups while that saves work.
std::vector<CellRect> merge(std::vector<CellRect> groups, const RegionRule& rule, uint32_t width,
                            uint32_t height) {
    const auto cost = [&](const CellRect& group) {
        return make_window(group, rule, width, height).computed.area() + kWindowCost;
    };
    for (size_t i = 0; i < groups.size();) {
        std::optional<size_t> partner;
        for (size_t j = i + 1; j < groups.size() && !partner; ++j) {
            if (cost(unite(groups[i], groups[j])) <= cost(groups[i]) + cost(groups[j])) {
                partner = j;
            }
        }
        if (partner) {
            groups[i] = unite(groups[i], groups[*partner]);
            groups.erase(groups.begin() + static_cast<ptrdiff_t>(*partner));
            i = 0; // what was apart from the old ones may be worth uniting with this one
        } else {
            ++i;
        }
    }
    return groups;
}

/// Distance of a place to a cell on one axis, pixels.
float beyond(uint32_t place, uint32_t cell) {
    const uint32_t begin = cell * activity_cell;
    const uint32_t last = begin + activity_cell - 1;
    return static_cast<float>(place < begin ? begin - place : place > last ? place - last : 0U);
}

/// The active ones of a cell and its neighbours.
std::vector<CellRect> active_around(const ActivityMap& map, uint32_t column, uint32_t row) {
    std::vector<CellRect> found;
    for (uint32_t r = row - std::min(row, 1U); r < std::min(row + 2, map.rows); ++r) {
        for (uint32_t c = column - std::min(column, 1U); c < std::min(column + 2, map.columns);
             ++c) {
            if (map.at(c, r)) {
                found.push_back({c, r, c + 1, r + 1});
            }
        }
    }
    return found;
}

/// 1 in active cells, falling to 0 over `fade` pixels around them, ever more slowly.
std::vector<float> fading(const ActivityMap& map, uint32_t fade, uint32_t width, uint32_t height) {
    std::vector<float> weight(size_t{width} * height);
    const auto reach = static_cast<float>(fade + 1);
    for (uint32_t row = 0; row < map.rows; ++row) {
        for (uint32_t column = 0; column < map.columns; ++column) {
            const auto around = active_around(map, column, row);
            const uint32_t right = std::min(width, (column + 1) * activity_cell);
            const uint32_t bottom = std::min(height, (row + 1) * activity_cell);
            for (uint32_t y = row * activity_cell; y < bottom; ++y) {
                for (uint32_t x = column * activity_cell; x < right; ++x) {
                    float& value = weight[size_t{y} * width + x];
                    for (const CellRect& cell : around) {
                        const float away = std::hypot(beyond(x, cell.left), beyond(y, cell.top));
                        const float share = std::max(0.0F, 1 - away / reach);
                        value = std::max(value, share * share);
                    }
                }
            }
        }
    }
    return weight;
}

} // namespace

Regions find_regions(const ActivityMap& map, const RegionRule& rule, uint32_t width,
                     uint32_t height) {
    Regions regions;
    const size_t image = size_t{width} * height;
    size_t computed = 0;
    auto groups = cell_groups(map);
    if (groups.size() <= kMostGroups) {
        groups = merge(std::move(groups), rule, width, height);
        for (const CellRect& group : groups) {
            regions.windows.push_back(make_window(group, rule, width, height));
            computed += regions.windows.back().computed.area() + kWindowCost;
        }
    } else {
        computed = image;
    }
    if (static_cast<double>(computed) >= most_window_share * static_cast<double>(image)) {
        const PixelRect all{0, 0, width, height};
        regions.windows = {{all, all}};
    } else if (rule.fade > 0 && !regions.windows.empty()) {
        regions.weight = fading(map, rule.fade, width, height);
    }
    return regions;
}

Events crop_events(const EventView& events, const PixelRect& rect) {
    Events inside;
    for (size_t i = 0; i < events.size(); ++i) {
        const uint16_t x = events.x[i];
        const uint16_t y = events.y[i];
        if (rect.contains(x, y)) {
            inside.push_back(events.t[i], static_cast<uint16_t>(x - rect.left),
                             static_cast<uint16_t>(y - rect.top), events.p[i]);
        }
    }
    return inside;
}

std::vector<float> crop_image(std::span<const float> image, uint32_t width, const PixelRect& rect) {
    std::vector<float> part;
    part.reserve(rect.area());
    for (uint32_t y = rect.top; y < rect.bottom; ++y) {
        const auto row = image.subspan(size_t{y} * width + rect.left, rect.width());
        part.insert(part.end(), row.begin(), row.end());
    }
    return part;
}

} // namespace ecir
