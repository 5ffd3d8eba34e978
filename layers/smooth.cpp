#include "layers/smooth.hpp"

#include <algorithm>
#include <bit>
#include <cstddef>

#include "layers/conv.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/smooth.comp.
struct Push {
    uint32_t from_origin = 0;
    uint32_t to_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t vertical = 0;
};
static_assert(sizeof(Push) == 20);

/// Mirrors the push constants of shaders/smooth_row.comp.
struct RowPush {
    uint64_t from_address = 0;
    uint32_t to_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t filler = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(RowPush) == 56);

using Constants = std::array<uint32_t, 8>; ///< of shaders/smooth.comp

Constants constants_of(const SmoothDesc& desc) {
    Constants constants{desc.reach, desc.step, desc.zero ? 1U : 0U};
    for (size_t k = 0; k < desc.weights.size(); ++k) {
        constants.at(3 + k) = std::bit_cast<uint32_t>(desc.weights.at(k));
    }
    return constants;
}

Dispatch axis_dispatch(Program& program, const SmoothDesc& desc, const Tensor& from,
                       const Tensor& to, bool vertical) {
    const Layout& layout = from.layout();
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("smooth", constants_of(desc), 2, sizeof(Push));
    dispatch.arguments = {read(from), write(to)};
    dispatch.set_push(Push{PushLayout(from).origin, PushLayout(to).origin, layout.width,
                           layout.height, vertical ? 1U : 0U});
    dispatch.groups = pixel_groups(layout, layout.channels);
    dispatch.flops = (1.0 + 3 * desc.reach) * static_cast<double>(layout.elements());
    dispatch.bytes = static_cast<double>(2 * to.bytes());
    dispatch.label = "smooth";
    return dispatch;
}

/// Both axes.
Dispatch row_dispatch(Program& program, const SmoothDesc& desc, const Tensor& from,
                      const Tensor& to) {
    constexpr uint32_t kMostVectors = 8;
    const Layout& layout = from.layout();
    const uint32_t lanes = program.device().info().subgroup_size;
    const RowTiles tiles(layout.width, lanes, kMostVectors);
    std::array<uint32_t, 10> constants{lanes, tiles.vectors};
    std::ranges::copy(constants_of(desc), constants.begin() + 2);
    RowPush push;
    push.to_origin = PushLayout(to).origin;
    push.width = layout.width;
    push.height = layout.height;
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("smooth_row", constants, 1, sizeof(push));
    dispatch.arguments = {write(to)};
    dispatch.pointers = {{offsetof(RowPush, from_address), read(from), 0}};
    dispatch.set_push(push);
    dispatch.groups = {tiles.count, layout.height, layout.channels};
    dispatch.flops = 2 * (1.0 + 3 * desc.reach) * static_cast<double>(layout.elements());
    dispatch.bytes = static_cast<double>(2 * to.bytes());
    dispatch.label = "smooth";
    return dispatch;
}

} // namespace

Tensor record_smooth(Program& program, const SmoothDesc& desc, const Tensor& from) {
    const Layout& layout = from.layout();
    require_shapes(layout.block == 1 && is_dense(from), "smooth", {from});
    if (desc.reach >= desc.weights.size()) {
        throw Error(ExitCode::bad_input,
                    "smooth: the reach is " + std::to_string(desc.reach) + ", more than 4");
    }
    const DeviceInfo& info = program.device().info();
    const Tensor to = program.temporary(layout);
    if (conv_family(info) == ConvFamily::lane && desc.reach * desc.step <= info.subgroup_size) {
        program.add(row_dispatch(program, desc, from, to));
        return to;
    }
    const Tensor between = program.temporary(layout);
    program.add(axis_dispatch(program, desc, from, between, false));
    program.add(axis_dispatch(program, desc, between, to, true));
    return to;
}

} // namespace ecir
