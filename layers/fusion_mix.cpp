#include "layers/fusion_mix.hpp"

#include <algorithm>

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

constexpr uint32_t kVector = 4;
constexpr uint32_t kRow = 1024; ///< workgroups along x

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
    const auto size = static_cast<uint32_t>(layout.elements() / kVector);
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_mix", {}, 3, sizeof(Push));
    dispatch.arguments = {read(features), read(instant), write(mixed)};
    dispatch.set_push(
        Push{origin(features, kVector), origin(instant), origin(mixed, kVector), size});
    const uint32_t groups = (size + 63) / 64; // can be more than a device launches along one axis
    dispatch.groups = {std::min(groups, kRow), (groups + kRow - 1) / kRow, 1};
    dispatch.flops = 7 * static_cast<double>(layout.elements());
    dispatch.bytes = static_cast<double>(features.bytes() + mixed.bytes());
    dispatch.label = "fusion_mix";
    program.add(std::move(dispatch));
}

} // namespace ecir
