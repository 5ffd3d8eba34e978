#include "layers/smooth.hpp"

#include <bit>

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

} // namespace

Tensor record_smooth(Program& program, const SmoothDesc& desc, const Tensor& from) {
    const Layout& layout = from.layout();
    require_shapes(layout.block == 1 && is_dense(from), "smooth", {from});
    if (desc.reach >= desc.weights.size()) {
        throw Error(ExitCode::bad_input,
                    "smooth: the reach is " + std::to_string(desc.reach) + ", more than 4");
    }
    std::array<uint32_t, 8> constants{desc.reach, desc.step, desc.zero ? 1U : 0U};
    for (size_t k = 0; k < desc.weights.size(); ++k) {
        constants.at(3 + k) = std::bit_cast<uint32_t>(desc.weights.at(k));
    }
    Tensor source = from;
    for (const uint32_t vertical : {0U, 1U}) {
        const Tensor target = program.temporary(layout);
        Dispatch dispatch;
        dispatch.kernel = &program.device().kernel("smooth", constants, 2, sizeof(Push));
        dispatch.arguments = {read(source), write(target)};
        dispatch.set_push(Push{PushLayout(source).origin, PushLayout(target).origin, layout.width,
                               layout.height, vertical});
        dispatch.groups = pixel_groups(layout, layout.channels);
        dispatch.flops = (1.0 + 3 * desc.reach) * static_cast<double>(layout.elements());
        dispatch.bytes = static_cast<double>(2 * target.bytes());
        dispatch.label = "smooth";
        program.add(std::move(dispatch));
        source = target;
    }
    return source;
}

} // namespace ecir
