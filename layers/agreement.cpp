#include "layers/agreement.hpp"

#include <array>

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/agreement.comp.
struct Push {
    uint32_t differences_origin = 0;
    uint32_t frame_origin = 0;
    uint32_t frame_row = 0;
    uint32_t to_origin = 0;
    uint32_t to_row = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    float scale = 0;
};
static_assert(sizeof(Push) == 32);

constexpr uint32_t kRows = 4;           ///< ROWS of shaders/agreement.comp
constexpr float kNeighbourhood = 3 * 3; ///< pixels

} // namespace

void record_agreement(Program& program, const Tensor& differences, const Tensor& frame,
                      const Tensor& to) {
    const Layout& layout = differences.layout();
    const auto good = [&](const Tensor& tensor) {
        return has_shape(tensor, 1, layout.height, layout.width) && tensor.layout().block == 1;
    };
    require_shapes(layout.channels == reference_count && is_dense(differences) && good(frame) &&
                       good(to),
                   "agreement", {differences, frame, to});
    constexpr std::array kConstants = {reference_count};
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel("agreement", kConstants, 3, sizeof(Push));
    dispatch.arguments = {read(differences), read(frame), write(to)};
    dispatch.set_push(
        Push{.differences_origin = origin(differences),
             .frame_origin = PushLayout(frame).origin,
             .frame_row = PushLayout(frame).row,
             .to_origin = PushLayout(to).origin,
             .to_row = PushLayout(to).row,
             .width = layout.width,
             .height = layout.height,
             .scale = 1 / (kNeighbourhood * agreement_tolerance * agreement_tolerance)});
    Layout tiles = layout;
    tiles.height = ceil_div(layout.height, kRows);
    dispatch.groups = pixel_groups(tiles);
    const double pixels = double{1} * layout.height * layout.width;
    dispatch.flops = 15 * reference_count * pixels;
    dispatch.bytes = 4 * (reference_count + 2) * pixels;
    dispatch.label = "agreement";
    program.add(std::move(dispatch));
}

} // namespace ecir
