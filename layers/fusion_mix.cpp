#include "layers/fusion_mix.hpp"

#include "layers/pixel_dispatch.hpp"

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
    if (layout.halo != 0 || source.halo != 0 || layout.block % kVector != 0 ||
        source.block != layout.block || source.height != layout.height ||
        source.width != layout.width || source.elements() != fusion_basis * layout.elements() ||
        instant.layout().elements() != instant_layout(1).elements()) {
        throw Error(ExitCode::bad_input, "fusion mix: the tensors' shapes do not match");
    }
    const auto size = static_cast<uint32_t>(layout.elements() / kVector);
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_mix", {}, 3, sizeof(Push));
    dispatch.arguments = {read(features), read(instant), write(mixed)};
    dispatch.set_push(Push{PushLayout(features).origin / kVector, PushLayout(instant).origin,
                           PushLayout(mixed).origin / kVector, size});
    dispatch.groups = {(size + 63) / 64, 1, 1};
    dispatch.flops = 7 * static_cast<double>(layout.elements());
    dispatch.bytes = static_cast<double>(features.bytes() + mixed.bytes());
    dispatch.label = "fusion_mix";
    program.add(std::move(dispatch));
}

} // namespace ecir
