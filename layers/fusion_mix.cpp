#include "layers/fusion_mix.hpp"

#include <algorithm>
#include <array>
#include <cstddef>

#include "layers/conv.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/fusion_mix.comp.
struct Push {
    uint32_t features_origin = 0;
    uint32_t instant_origin = 0;
    uint32_t mixed_origin = 0;
    uint32_t size = 0;
};
static_assert(sizeof(Push) == 16);

/// Mirrors the push constants of shaders/fusion_mix_row.comp.
struct RowPush {
    uint64_t features_address = 0;
    uint64_t instant_address = 0;
    uint32_t mixed_origin = 0;
    uint32_t size = 0;
    uint32_t columns = 0;
    uint32_t filler = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(RowPush) == 64);

constexpr uint32_t kVector = 4;

/// Can be more than a device launches along one axis.
std::array<uint32_t, 3> flat_groups(uint32_t count) {
    constexpr uint32_t kRow = 1024;
    return {std::min(count, kRow), ceil_div(count, kRow), 1};
}

Dispatch vector_dispatch(Program& program, const Tensor& features, const Tensor& instant,
                         const Tensor& mixed) {
    const auto size = static_cast<uint32_t>(mixed.layout().elements() / kVector);
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_mix", {}, 3, sizeof(Push));
    dispatch.arguments = {read(features), read(instant), write(mixed)};
    dispatch.set_push(
        Push{origin(features, kVector), origin(instant), origin(mixed, kVector), size});
    dispatch.groups = flat_groups(ceil_div(size, 64));
    return dispatch;
}

Dispatch row_dispatch(Program& program, const Tensor& features, const Tensor& instant,
                      const Tensor& mixed) {
    constexpr uint32_t kVectors = 16;
    const uint32_t lanes = program.device().info().subgroup_size;
    const std::array<uint32_t, 2> constants{lanes, kVectors};
    RowPush push;
    push.mixed_origin = origin(mixed);
    push.size = static_cast<uint32_t>(mixed.layout().elements());
    Dispatch dispatch;
    dispatch.groups = flat_groups(ceil_div(push.size, kVectors * lanes));
    push.columns = dispatch.groups[0];
    dispatch.kernel = &program.device().kernel("fusion_mix_row", constants, 1, sizeof(push));
    dispatch.arguments = {write(mixed)};
    dispatch.pointers = {{offsetof(RowPush, features_address), read(features), 0},
                         {offsetof(RowPush, instant_address), read(instant), 0}};
    dispatch.set_push(push);
    return dispatch;
}

} // namespace

Layout fusion_basis_layout(const Layout& mixed) {
    Layout layout = mixed;
    layout.channels = fusion_basis * padded_channels(mixed);
    return layout;
}

void record_fusion_mix(Program& program, const Tensor& features, const Tensor& instant,
                       const Tensor& mixed) {
    const Layout& layout = mixed.layout();
    const Layout& source = features.layout();
    require_shapes(is_dense(mixed) && is_dense(features) && layout.elements() % kVector == 0 &&
                       has_shape(features, fusion_basis_layout(layout).channels, layout.height,
                                 layout.width) &&
                       source.block == layout.block && is_instant(instant),
                   "fusion mix", {features, instant, mixed});
    Dispatch dispatch = conv_family(program.device().info()) == ConvFamily::lane
                            ? row_dispatch(program, features, instant, mixed)
                            : vector_dispatch(program, features, instant, mixed);
    dispatch.flops = 7 * static_cast<double>(layout.elements());
    dispatch.bytes = static_cast<double>(features.bytes() + mixed.bytes());
    dispatch.label = "fusion_mix";
    program.add(std::move(dispatch));
}

} // namespace ecir
