#include "layers/fusion_fetch.hpp"

#include <array>
#include <cstddef>

#include "layers/conv.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// What is fetched: frames at every step-th anchor; the differences go to the channels first, ...
/// of `planes`, in the order of the anchors or nearest in time first.
struct Fetch {
    Tensor frames;
    Tensor away;
    Tensor instant;
    Tensor base;
    Tensor planes;
    uint32_t first = 0;
    uint32_t step = 1;
    bool ranked = false;

    [[nodiscard]] uint32_t count() const { return frames.layout().channels; }
    [[nodiscard]] std::array<uint32_t, 3> constants() const {
        return {count(), step, ranked ? 1U : 0U};
    }
};

/// Mirrors the push constants of shaders/fusion_fetch.comp.
struct FetchPush {
    PushLayout frames;
    PushLayout base;
    PushLayout planes;
    uint32_t away_origin = 0;
    uint32_t instant_origin = 0;
    uint32_t first = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t cell_width = 0;
    uint32_t cell_height = 0;
};
static_assert(sizeof(FetchPush) == 76);

constexpr uint32_t kTileRows =
    4; ///< ROWS of shaders/fusion_fetch.comp, SIDE of fusion_fetch_row.comp

/// Mirrors the push constants of shaders/fusion_fetch_row.comp.
struct RowPush {
    uint64_t frames_address = 0;
    uint64_t away_address = 0;
    uint64_t base_address = 0;
    uint64_t instant_address = 0;
    uint32_t frames_row = 0;
    uint32_t frames_plane = 0;
    uint32_t base_row = 0;
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
constexpr uint32_t kDifferences = 2; ///< of the head's input: the first channel of them

Dispatch row_dispatch(Program& program, const Fetch& fetch) {
    const Layout& frames = fetch.frames.layout();
    const Layout& base = fetch.base.layout();
    const Layout& layout = fetch.planes.layout();
    const Layout& cells = fetch.away.layout();
    const Tensor differences = fetch.planes.channels(fetch.first, fetch.count());
    RowPush push;
    push.frames_row = static_cast<uint32_t>(frames.row_stride());
    push.frames_plane = static_cast<uint32_t>(frames.plane_stride());
    push.base_row = static_cast<uint32_t>(base.row_stride());
    push.planes_origin = PushLayout(differences).origin;
    push.planes_row = static_cast<uint32_t>(layout.row_stride());
    push.planes_plane = static_cast<uint32_t>(layout.plane_stride());
    push.width = layout.width;
    push.height = layout.height;
    push.cell_width = cells.width;
    push.cell_height = cells.height;
    Dispatch dispatch;
    dispatch.kernel =
        &program.device().kernel("fusion_fetch_row", fetch.constants(), 1, sizeof(push));
    dispatch.arguments = {update(differences)};
    dispatch.pointers = {
        {offsetof(RowPush, frames_address), read(fetch.frames), frames.origin() * 4},
        {offsetof(RowPush, away_address), read(fetch.away), 0},
        {offsetof(RowPush, base_address), read(fetch.base), base.origin() * 4},
        {offsetof(RowPush, instant_address), read(fetch.instant), 0}};
    dispatch.set_push(push);
    dispatch.groups = {ceil_div(layout.width, kRowLanes), ceil_div(layout.height, kTileRows), 1};
    return dispatch;
}

Dispatch pixel_dispatch(Program& program, const Fetch& fetch) {
    const Layout& layout = fetch.planes.layout();
    const Layout& cells = fetch.away.layout();
    Dispatch dispatch;
    dispatch.kernel =
        &program.device().kernel("fusion_fetch", fetch.constants(), 5, sizeof(FetchPush));
    dispatch.arguments = {read(fetch.frames), read(fetch.away), read(fetch.instant),
                          read(fetch.base), update(fetch.planes)};
    dispatch.set_push(FetchPush{PushLayout(fetch.frames), PushLayout(fetch.base),
                                PushLayout(fetch.planes), origin(fetch.away, cells.block),
                                origin(fetch.instant), fetch.first, layout.width, layout.height,
                                cells.width, cells.height});
    Layout tiles = layout;
    tiles.height = ceil_div(layout.height, kTileRows);
    dispatch.groups = pixel_groups(tiles, fetch.count());
    return dispatch;
}

void record(Program& program, const Fetch& fetch, const char* label) {
    const Layout& layout = fetch.planes.layout();
    const Layout& cells = fetch.away.layout();
    const Layout wanted = away_layout(layout.height, layout.width);
    require_shapes(has_shape(fetch.away, wanted.channels, wanted.height, wanted.width) &&
                       cells.block == wanted.block && is_dense(fetch.away) &&
                       is_instant(fetch.instant) && fetch.frames.layout().block == 1 &&
                       has_shape(fetch.frames, fetch.count(), layout.height, layout.width) &&
                       has_shape(fetch.base, 1, layout.height, layout.width),
                   label, {fetch.frames, fetch.away, fetch.instant, fetch.base, fetch.planes});
    const DeviceInfo& info = program.device().info();
    const bool rows = conv_family(info) == ConvFamily::lane && info.subgroup_size == kRowLanes &&
                      layout.block == 1 && fetch.base.layout().block == 1;
    Dispatch dispatch = rows ? row_dispatch(program, fetch) : pixel_dispatch(program, fetch);
    const double pixels = double{1} * layout.width * layout.height;
    dispatch.flops = 45 * fetch.count() * pixels;
    dispatch.bytes = 4 * (2 * fetch.count() + 1) * pixels;
    dispatch.label = label;
    program.add(std::move(dispatch));
}

} // namespace

void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes) {
    require_shapes(planes.layout().channels == plane_count &&
                       anchors.layout().channels == anchor_count,
                   "fusion fetch", {anchors, planes});
    record(program,
           {.frames = anchors,
            .away = away,
            .instant = instant,
            .base = planes.channels(0, 1),
            .planes = planes,
            .first = kDifferences,
            .ranked = true},
           "fusion_fetch");
}

void record_reference_fetch(Program& program, const Tensor& references, const Tensor& away,
                            const Tensor& instant, const Tensor& frame, const Tensor& differences) {
    require_shapes(references.layout().channels == reference_count &&
                       differences.layout().channels == reference_count && is_dense(differences),
                   "reference fetch", {references, differences});
    constexpr uint32_t kStep = (anchor_count - 1) / (reference_count - 1);
    record(program,
           {.frames = references,
            .away = away,
            .instant = instant,
            .base = frame,
            .planes = differences,
            .step = kStep},
           "reference_fetch");
}

} // namespace ecir
