#include "layers/trajectory.hpp"

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/trajectory.comp.
struct TrajectoryPush {
    uint32_t moved_origin = 0;
    uint32_t instant_origin = 0;
    uint32_t away_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
};
static_assert(sizeof(TrajectoryPush) == 20);

constexpr uint32_t kComponents = 2;

} // namespace

void record_trajectory(Program& program, const Tensor& moved, const Tensor& instant,
                       const Tensor& away) {
    const Layout& layout = moved.layout();
    require_shapes(layout.channels == kComponents * (anchor_count - 1) &&
                       layout.block == kComponents && is_dense(moved) && is_instant(instant) &&
                       has_shape(away, kComponents * anchor_count, layout.height, layout.width) &&
                       is_dense(away) && away.layout().block == kComponents,
                   "trajectory", {moved, instant, away});
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("trajectory", {}, 3, sizeof(TrajectoryPush));
    dispatch.arguments = {read(moved), read(instant), write(away)};
    dispatch.set_push(TrajectoryPush{origin(moved, kComponents), origin(instant),
                                     origin(away, kComponents), layout.width, layout.height});
    constexpr uint32_t kDirections = 2;
    dispatch.groups = pixel_groups(layout, kDirections);
    dispatch.flops = 30 * static_cast<double>(away.layout().elements());
    dispatch.bytes = static_cast<double>(moved.bytes() + away.bytes());
    dispatch.label = "trajectory";
    program.add(std::move(dispatch));
}

} // namespace ecir
