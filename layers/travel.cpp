#include "layers/travel.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "layers/plane_smooth.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

constexpr uint32_t kSlices = 16;
constexpr uint32_t kLargestSide = 256;
constexpr uint32_t kTile = 24;     // binned pixels a side
constexpr float kThreshold = 0.2F; // common to sensors within a factor of two, and so is the result
constexpr float kOffset = 0.01F;
constexpr float kRidge = 0.02F; // squared gradient of a tile that is mere noise
constexpr float kLargest = 30;  // of |E|: exp() stays finite

/// An image, binned.
struct Grid {
    uint32_t bin;
    uint32_t width;
    uint32_t height;
    [[nodiscard]] size_t size() const { return size_t{width} * height; }
};

/// ln(B + e), averaged over the bins.
std::vector<float> binned_logarithm(const Grid& grid, std::span<const float> blurry,
                                    uint32_t width) {
    std::vector<float> result(grid.size());
    const float share = 1.0F / static_cast<float>(grid.bin * grid.bin);
    for (uint32_t y = 0; y < grid.height * grid.bin; ++y) {
        for (uint32_t x = 0; x < grid.width * grid.bin; ++x) {
            result[size_t{y / grid.bin} * grid.width + x / grid.bin] +=
                share * std::log(std::max(blurry[size_t{y} * width + x], 0.0F) + kOffset);
        }
    }
    return result;
}

/// Change of the logarithm in each slice, [slice][bin].
std::vector<float> binned_changes(const Grid& grid, const EventView& events,
                                  const Exposure& exposure) {
    std::vector<float> result(kSlices * grid.size());
    const float step = kThreshold / static_cast<float>(grid.bin * grid.bin);
    const double scale = kSlices / (static_cast<double>(exposure.duration()) + 1);
    for (size_t i = 0; i < events.size(); ++i) {
        const uint32_t x = events.x[i] / grid.bin;
        const uint32_t y = events.y[i] / grid.bin;
        if (x < grid.width && y < grid.height) {
            const auto slice = std::min(
                static_cast<uint32_t>(static_cast<double>(events.t[i] - exposure.start) * scale),
                kSlices - 1);
            result[slice * grid.size() + size_t{y} * grid.width + x] +=
                events.p[i] != 0 ? step : -step;
        }
    }
    return result;
}

/// One motion a tile, with the path's length so far and what it explained.
struct Tile {
    double path = 0;
    double explained = 0;
};

void add_slice(const Grid& grid, const std::vector<float>& level, const std::vector<float>& change,
               uint32_t columns, std::vector<Tile>& tiles) {
    for (size_t t = 0; t < tiles.size(); ++t) {
        const uint32_t left = static_cast<uint32_t>(t) % columns * kTile;
        const uint32_t top = static_cast<uint32_t>(t) / columns * kTile;
        float xx = kRidge;
        float xy = 0;
        float yy = kRidge;
        float xd = 0;
        float yd = 0;
        for (uint32_t y = top; y < std::min(top + kTile, grid.height); ++y) {
            const size_t up = size_t{y > 0 ? y - 1 : 0} * grid.width;
            const size_t here = size_t{y} * grid.width;
            const size_t down = size_t{std::min(y + 1, grid.height - 1)} * grid.width;
            for (uint32_t x = left; x < std::min(left + kTile, grid.width); ++x) {
                const float gx = 0.5F * (level[here + std::min(x + 1, grid.width - 1)] -
                                         level[here + (x > 0 ? x - 1 : 0)]);
                const float gy = 0.5F * (level[down + x] - level[up + x]);
                const float d = change[here + x];
                xx += gx * gx;
                xy += gx * gy;
                yy += gy * gy;
                xd -= gx * d;
                yd -= gy * d;
            }
        }
        const float determinant = xx * yy - xy * xy;
        const float vx = (yy * xd - xy * yd) / determinant;
        const float vy = (xx * yd - xy * xd) / determinant;
        tiles[t].path += static_cast<double>(std::hypot(vx, vy));
        tiles[t].explained += static_cast<double>(std::max(vx * xd + vy * yd, 0.0F));
    }
}

double weighted_median(std::vector<Tile>& tiles) {
    std::ranges::sort(tiles, {}, &Tile::path);
    const double all =
        std::accumulate(tiles.begin(), tiles.end(), 0.0,
                        [](double sum, const Tile& tile) { return sum + tile.explained; });
    double sum = 0;
    for (const Tile& tile : tiles) {
        sum += tile.explained;
        if (sum > 0 && 2 * sum >= all) {
            return tile.path;
        }
    }
    return 0;
}

} // namespace

double estimate_travel(std::span<const float> blurry, const EventView& events,
                       const Exposure& exposure, uint32_t width, uint32_t height) {
    const uint32_t bin = ceil_div(std::max(width, height), kLargestSide);
    const Grid grid{bin, width / bin, height / bin};
    if (grid.size() == 0 || events.size() == 0) {
        return 0;
    }
    const std::vector<float> still = binned_logarithm(grid, blurry, width);
    const std::vector<float> changes = binned_changes(grid, events, exposure);

    // E at the middle of each slice, and from the mean of exp(E) the level at the start.
    std::vector<float> sum(grid.size());
    std::vector<float> integral(grid.size());
    for (uint32_t slice = 0; slice < kSlices; ++slice) {
        const float* const change = &changes[slice * grid.size()];
        for (size_t i = 0; i < grid.size(); ++i) {
            integral[i] += std::exp(std::clamp(sum[i] + 0.5F * change[i], -kLargest, kLargest));
            sum[i] += change[i];
        }
    }
    std::vector<float> start(grid.size());
    for (size_t i = 0; i < grid.size(); ++i) {
        start[i] = still[i] - std::log(integral[i] / kSlices);
    }

    const uint32_t columns = ceil_div(grid.width, kTile);
    std::vector<Tile> tiles(size_t{columns} * ceil_div(grid.height, kTile));
    std::vector<float> level(grid.size());
    std::vector<float> change(grid.size());
    std::ranges::fill(sum, 0.0F);
    for (uint32_t slice = 0; slice < kSlices; ++slice) {
        std::copy_n(changes.begin() + static_cast<ptrdiff_t>(slice * grid.size()), grid.size(),
                    change.begin());
        for (size_t i = 0; i < grid.size(); ++i) {
            level[i] = start[i] + sum[i] + 0.5F * change[i];
            sum[i] += change[i];
        }
        smooth_plane(level, grid.width, grid.height);
        smooth_plane(change, grid.width, grid.height);
        add_slice(grid, level, change, columns, tiles);
    }
    return weighted_median(tiles) * bin;
}

} // namespace ecir
