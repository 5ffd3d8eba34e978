#include "layers/fusion_fetch.hpp"

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/fusion_fetch.comp.
struct FetchPush {
    PushLayout anchors;
    PushLayout planes;
    uint32_t away_origin = 0;
    uint32_t instant_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t cell_width = 0;
    uint32_t cell_height = 0;
};
static_assert(sizeof(FetchPush) == 56);

constexpr uint32_t kTile = 4; ///< pixels a side of a tile of shaders/fusion_fetch.comp

} // namespace

void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes) {
    const Layout& layout = planes.layout();
    const Layout& cells = away.layout();
    const Layout wanted = motion_layout(layout.height, layout.width);
    require_shapes(has_shape(away, wanted.channels, wanted.height, wanted.width) &&
                       cells.block == wanted.block && is_dense(away) && is_instant(instant) &&
                       layout.channels == plane_count && anchors.layout().block == 1 &&
                       has_shape(anchors, anchor_count, layout.height, layout.width),
                   "fusion fetch", {anchors, away, instant, planes});
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_fetch", {}, 4, sizeof(FetchPush));
    dispatch.arguments = {read(anchors), read(away), read(instant), update(planes)};
    dispatch.set_push(FetchPush{PushLayout(anchors), PushLayout(planes), origin(away, cells.block),
                                origin(instant), layout.width, layout.height, cells.width,
                                cells.height});
    Layout tiles = layout;
    tiles.height = (layout.height + kTile - 1) / kTile;
    tiles.width = (layout.width + kTile - 1) / kTile;
    dispatch.groups = pixel_groups(tiles);
    const double pixels = double{1} * layout.width * layout.height;
    dispatch.flops = 45 * anchor_count * pixels;
    dispatch.bytes = 4 * (2 * anchor_count + 1) * pixels;
    dispatch.label = "fusion_fetch";
    program.add(std::move(dispatch));
}

} // namespace ecir
