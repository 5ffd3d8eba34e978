#include "layers/fusion_fetch.hpp"

#include <array>
#include <cstddef>

#include "layers/conv.hpp"
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

/// Mirrors the push constants of shaders/fusion_fetch_row.comp.
struct RowPush {
    uint64_t anchors_address = 0;
    uint64_t away_address = 0;
    uint64_t prior_address = 0;
    uint64_t instant_address = 0;
    uint32_t anchors_row = 0;
    uint32_t anchors_plane = 0;
    uint32_t prior_row = 0;
    uint32_t planes_origin = 0;
    uint32_t planes_row = 0;
    uint32_t planes_plane = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t cell_width = 0;
    uint32_t cell_height = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(RowPush) == 104);

constexpr uint32_t kRowLanes = 8;    ///< LX of shaders/fusion_fetch_row.comp
constexpr uint32_t kDifferences = 2; ///< the first channel of them

Dispatch row_dispatch(Program& program, const Tensor& anchors, const Tensor& away,
                      const Tensor& instant, const Tensor& planes) {
    const Layout& frames = anchors.layout();
    const Layout& layout = planes.layout();
    const Layout& cells = away.layout();
    const Tensor differences = planes.channels(kDifferences, anchor_count);
    RowPush push;
    push.anchors_row = static_cast<uint32_t>(frames.row_stride());
    push.anchors_plane = static_cast<uint32_t>(frames.plane_stride());
    push.prior_row = static_cast<uint32_t>(layout.row_stride());
    push.planes_origin = PushLayout(differences).origin;
    push.planes_row = push.prior_row;
    push.planes_plane = static_cast<uint32_t>(layout.plane_stride());
    push.width = layout.width;
    push.height = layout.height;
    push.cell_width = cells.width;
    push.cell_height = cells.height;
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_fetch_row", {}, 1, sizeof(push));
    dispatch.arguments = {update(differences)};
    dispatch.pointers = {{offsetof(RowPush, anchors_address), read(anchors), frames.origin() * 4},
                         {offsetof(RowPush, away_address), read(away), 0},
                         {offsetof(RowPush, prior_address), read(planes), layout.origin() * 4},
                         {offsetof(RowPush, instant_address), read(instant), 0}};
    dispatch.set_push(push);
    dispatch.groups = {ceil_div(layout.width, kRowLanes), ceil_div(layout.height, kTile), 1};
    return dispatch;
}

Dispatch pixel_dispatch(Program& program, const Tensor& anchors, const Tensor& away,
                        const Tensor& instant, const Tensor& planes) {
    const Layout& layout = planes.layout();
    const Layout& cells = away.layout();
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_fetch", {}, 4, sizeof(FetchPush));
    dispatch.arguments = {read(anchors), read(away), read(instant), update(planes)};
    dispatch.set_push(FetchPush{PushLayout(anchors), PushLayout(planes), origin(away, cells.block),
                                origin(instant), layout.width, layout.height, cells.width,
                                cells.height});
    Layout tiles = layout;
    tiles.height = ceil_div(layout.height, kTile);
    tiles.width = ceil_div(layout.width, kTile);
    dispatch.groups = pixel_groups(tiles);
    return dispatch;
}

} // namespace

void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes) {
    const Layout& layout = planes.layout();
    const Layout& cells = away.layout();
    const Layout wanted = away_layout(layout.height, layout.width);
    require_shapes(has_shape(away, wanted.channels, wanted.height, wanted.width) &&
                       cells.block == wanted.block && is_dense(away) && is_instant(instant) &&
                       layout.channels == plane_count && anchors.layout().block == 1 &&
                       has_shape(anchors, anchor_count, layout.height, layout.width),
                   "fusion fetch", {anchors, away, instant, planes});
    const DeviceInfo& info = program.device().info();
    const bool rows = conv_family(info) == ConvFamily::lane && info.subgroup_size == kRowLanes &&
                      layout.block == 1;
    Dispatch dispatch = rows ? row_dispatch(program, anchors, away, instant, planes)
                             : pixel_dispatch(program, anchors, away, instant, planes);
    const double pixels = double{1} * layout.width * layout.height;
    dispatch.flops = 45 * anchor_count * pixels;
    dispatch.bytes = 4 * (2 * anchor_count + 1) * pixels;
    dispatch.label = "fusion_fetch";
    program.add(std::move(dispatch));
}

} // namespace ecir
