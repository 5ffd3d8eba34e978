#pragma once
#include <algorithm>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "runtime/device.hpp"
#include "runtime/error.hpp"
#include "runtime/tensor.hpp"

namespace ecir {

/// What the kernels with one invocation a pixel share: workgroup counts and views that a device can
/// bind.

/// Workgroups of 64 x 1 x 1 invocations that cover `depth` images.
inline std::array<uint32_t, 3> pixel_groups(const Layout& layout, uint32_t depth = 1) {
    return {(layout.width + 63) / 64, layout.height, depth};
}

/// A row cut into tiles for kernels that take several vectors of `lanes` pixels a workgroup: as few
/// tiles as can do, of a number of vectors that is the same for all.
struct RowTiles {
    static constexpr uint32_t kMostVectors = 10; ///< more gain nothing
    uint32_t count;
    uint32_t vectors;
    RowTiles(uint32_t width, uint32_t lanes, uint32_t most_vectors = kMostVectors) {
        const uint32_t all = (width + lanes - 1) / lanes;
        count = (all + most_vectors - 1) / most_vectors;
        vectors = (all + count - 1) / count;
    }
};

/// Channels first, ..., first + count - 1 of a tensor.
struct ChannelGroup {
    uint32_t first;
    uint32_t count;
};

/// Cuts the channels of a layout into groups whose views the device can bind: each starts at a
/// multiple of `step` (itself a multiple of the layout's block) and fits the storage-buffer range
/// together with `margin` more channels; one group where everything fits. Throws Error(resources)
/// when not even `step` channels do.
inline std::vector<ChannelGroup> channel_groups(const DeviceInfo& device, const Layout& layout,
                                                uint32_t step, uint32_t margin = 0) {
    if (layout.elements() * 4 + kBindingAlignment <= device.max_storage_range) {
        return {{0, layout.channels}};
    }
    const uint64_t plane = layout.plane_stride() * 4;
    const uint64_t fit = (device.max_storage_range - kBindingAlignment) / plane * layout.block;
    if (fit < uint64_t{step} + margin) {
        throw Error(ExitCode::resources,
                    "a kernel needs a view of " +
                        std::to_string((step + margin + layout.block - 1) / layout.block * plane) +
                        " bytes of a " + std::to_string(layout.width) + "x" +
                        std::to_string(layout.height) + " tensor, but " + device.name +
                        " binds at most " + std::to_string(device.max_storage_range) +
                        "; use a smaller --size");
    }
    const auto size = static_cast<uint32_t>((fit - margin) / step * step);
    std::vector<ChannelGroup> groups;
    for (uint32_t first = 0; first < layout.channels; first += size) {
        groups.push_back({first, std::min(size, layout.channels - first)});
    }
    return groups;
}

/// The smallest view that holds the channels first, ..., first + count - 1; the first of them is
/// the view's channel `skip`.
struct ChannelView {
    Tensor tensor;
    uint32_t skip = 0;
};
inline ChannelView channel_view(const Tensor& tensor, uint32_t first, uint32_t count) {
    const uint32_t skip = first % tensor.layout().block;
    return {tensor.channels(first - skip, count + skip), skip};
}

/// Channels of a layout with those that fill up its last block.
inline uint32_t padded_channels(const Layout& layout) {
    return layout.blocks() * layout.block;
}

} // namespace ecir
