#include "layers/trajectory.hpp"

#include "layers/pixel_dispatch.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/trajectory.comp.
struct TrajectoryPush {
    uint32_t velocity_origin = 0;
    uint32_t instant_origin = 0;
    uint32_t away_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
};
static_assert(sizeof(TrajectoryPush) == 20);

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

constexpr uint32_t kComponents = 2;
constexpr uint32_t kTile = 4; ///< pixels a side of a tile of shaders/fusion_fetch.comp

void require(bool condition, const char* operation) {
    if (!condition) {
        throw Error(ExitCode::bad_input,
                    std::string(operation) + ": the tensors' shapes do not match");
    }
}

bool is_pairs(const Tensor& tensor) {
    const Layout& layout = tensor.layout();
    return layout.channels == kComponents * anchor_count && layout.block == kComponents &&
           layout.halo == 0 && layout.pitch == 0;
}

bool is_instant(const Tensor& tensor) {
    return tensor.layout().elements() == instant_layout(1).elements();
}

/// Origin of a tensor of motion_layout(), in pairs.
uint32_t pair_origin(const Tensor& tensor) {
    return PushLayout(tensor).origin / kComponents;
}

} // namespace

void record_trajectory(Program& program, const Tensor& velocity, const Tensor& instant,
                       const Tensor& away) {
    const Layout& layout = velocity.layout();
    require(is_pairs(velocity) && is_pairs(away) && is_instant(instant) &&
                away.layout().height == layout.height && away.layout().width == layout.width,
            "trajectory");
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("trajectory", {}, 3, sizeof(TrajectoryPush));
    dispatch.arguments = {read(velocity), read(instant), write(away)};
    dispatch.set_push(TrajectoryPush{pair_origin(velocity), PushLayout(instant).origin,
                                     pair_origin(away), layout.width, layout.height});
    constexpr uint32_t kDirections = 2;
    dispatch.groups = pixel_groups(layout, kDirections);
    dispatch.flops = 30 * static_cast<double>(layout.elements());
    dispatch.bytes = static_cast<double>(velocity.bytes() + away.bytes());
    dispatch.label = "trajectory";
    program.add(std::move(dispatch));
}

void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes) {
    const Layout& layout = planes.layout();
    const Layout& cells = away.layout();
    const Layout wanted = motion_layout(layout.height, layout.width);
    require(is_pairs(away) && is_instant(instant) && layout.channels == plane_count &&
                anchors.layout().channels == anchor_count && anchors.layout().block == 1 &&
                anchors.layout().height == layout.height &&
                anchors.layout().width == layout.width && cells.height == wanted.height &&
                cells.width == wanted.width,
            "fusion fetch");
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("fusion_fetch", {}, 4, sizeof(FetchPush));
    dispatch.arguments = {read(anchors), read(away), read(instant), update(planes)};
    dispatch.set_push(FetchPush{PushLayout(anchors), PushLayout(planes), pair_origin(away),
                                PushLayout(instant).origin, layout.width, layout.height,
                                cells.width, cells.height});
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
