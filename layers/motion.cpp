#include "layers/motion.hpp"

#include <array>
#include <cstddef>

#include "layers/conv.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"
#include "layers/smooth.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/motion_moments.comp.
struct MomentPush {
    uint32_t frames_origin = 0;
    uint32_t moments_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t columns = 0;
    uint32_t rows = 0;
};
static_assert(sizeof(MomentPush) == 24);

/// Mirrors the push constants of shaders/motion_moments_row.comp.
struct MomentRowPush {
    uint64_t frames_address = 0;
    uint32_t moments_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t columns = 0;
    uint32_t rows = 0;
    uint32_t filler = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(MomentRowPush) == 64);

/// Mirrors the push constants of shaders/motion_slopes.comp.
struct SlopePush {
    uint32_t frames_origin = 0;
    uint32_t slopes_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
};
static_assert(sizeof(SlopePush) == 16);

/// Mirrors the push constants of shaders/motion_round.comp.
struct RoundPush {
    uint32_t slopes_origin = 0;
    uint32_t moved_origin = 0;
    uint32_t moments_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t columns = 0;
    uint32_t rows = 0;
};
static_assert(sizeof(RoundPush) == 28);

/// Mirrors the push constants of shaders/motion_solve.comp.
struct SolvePush {
    uint32_t moments_origin = 0;
    uint32_t moved_origin = 0;
    uint32_t columns = 0;
    uint32_t rows = 0;
};
static_assert(sizeof(SolvePush) == 16);

/// Mirrors the push constants of shaders/motion_velocity.comp.
struct VelocityPush {
    PushLayout channels;
    uint32_t moved_origin = 0;
    uint32_t columns = 0;
    uint32_t rows = 0;
};
static_assert(sizeof(VelocityPush) == 28);

namespace shader {
using uint = uint32_t;
#include "shaders/fusion_constants.glsl"
} // namespace shader

constexpr uint32_t kCell = shader::CELL; ///< pixels a side
constexpr uint32_t kSide = kCell / 2;    ///< samples of half the resolution
constexpr uint32_t kComponents = 2;
constexpr uint32_t kMoments = 5;
constexpr uint32_t kSlopes = 4; ///< channels a sample: X, its gradient, one more
constexpr uint32_t kGaps = anchor_count - 1;

/// A dispatch whose bytes are those of its tensors.
Dispatch make(Program& program, const char* shader, std::span<const uint32_t> constants,
              std::vector<Argument> arguments, uint32_t push_bytes) {
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel(shader, constants,
                                               static_cast<uint32_t>(arguments.size()), push_bytes);
    for (const Argument& argument : arguments) {
        dispatch.bytes += static_cast<double>(argument.tensor.bytes());
    }
    dispatch.arguments = std::move(arguments);
    dispatch.label = shader;
    return dispatch;
}

/// Moments of the windows of each gap, of the layout `cells` has for each.
Tensor record_moments(Program& program, const Tensor& frames, const Layout& cells) {
    const Layout& layout = frames.layout();
    const Tensor moments = program.temporary({kMoments * kGaps, cells.height, cells.width});
    const DeviceInfo& info = program.device().info();
    Dispatch dispatch;
    if (conv_family(info) == ConvFamily::lane && info.subgroup_size % kSide == 0) {
        const std::array<uint32_t, 1> constants{info.subgroup_size};
        dispatch =
            make(program, "motion_moments_row", constants, {write(moments)}, sizeof(MomentRowPush));
        dispatch.pointers = {{offsetof(MomentRowPush, frames_address), read(frames), 0}};
        MomentRowPush push;
        push.moments_origin = origin(moments);
        push.width = layout.width;
        push.height = layout.height;
        push.columns = cells.width;
        push.rows = cells.height;
        dispatch.set_push(push);
        dispatch.groups = {ceil_div(layout.width, info.subgroup_size), cells.height, kGaps};
    } else {
        dispatch =
            make(program, "motion_moments", {}, {read(frames), write(moments)}, sizeof(MomentPush));
        dispatch.set_push(MomentPush{origin(frames), origin(moments), layout.width, layout.height,
                                     cells.width, cells.height});
        dispatch.groups = pixel_groups(cells, kGaps);
    }
    dispatch.label = "motion_moments";
    dispatch.flops = 2 * 26 * static_cast<double>(layout.elements());
    program.add(std::move(dispatch));
    return moments;
}

Tensor record_slopes(Program& program, const Tensor& frames) {
    const Layout& layout = frames.layout();
    const Tensor slopes =
        program.temporary({kSlopes * anchor_count, layout.height, layout.width, kSlopes});
    Dispatch dispatch =
        make(program, "motion_slopes", {}, {read(frames), write(slopes)}, sizeof(SlopePush));
    dispatch.set_push(
        SlopePush{origin(frames), origin(slopes, kSlopes), layout.width, layout.height});
    dispatch.groups = pixel_groups(layout, anchor_count);
    program.add(std::move(dispatch));
    return slopes;
}

/// Moments of what remains over the gaps.
Tensor record_round(Program& program, const Tensor& slopes, const Tensor& moved) {
    const Layout& layout = slopes.layout();
    const Layout& cells = moved.layout();
    const Tensor moments = program.temporary({kMoments * kGaps, cells.height, cells.width});
    Dispatch dispatch = make(program, "motion_round", {},
                             {read(slopes), read(moved), write(moments)}, sizeof(RoundPush));
    dispatch.set_push(RoundPush{origin(slopes, kSlopes), origin(moved, kComponents),
                                origin(moments), layout.width, layout.height, cells.width,
                                cells.height});
    dispatch.groups = pixel_groups(cells, kGaps);
    dispatch.flops = 80.0 * kGaps * layout.width * layout.height;
    program.add(std::move(dispatch));
    return moments;
}

void record_solve(Program& program, const Tensor& moments, const Tensor& moved, bool first) {
    const Layout& cells = moved.layout();
    const std::array<uint32_t, 1> constants = {first ? 1U : 0U};
    Dispatch dispatch =
        make(program, "motion_solve", constants, {read(moments), update(moved)}, sizeof(SolvePush));
    dispatch.set_push(
        SolvePush{origin(moments), origin(moved, kComponents), cells.width, cells.height});
    dispatch.groups = pixel_groups(cells, kGaps);
    dispatch.flops = 25 * static_cast<double>(cells.elements());
    program.add(std::move(dispatch));
}

} // namespace

Layout away_layout(uint32_t height, uint32_t width) {
    Layout layout = motion_layout(height, width);
    layout.channels = kComponents * anchor_count;
    return layout;
}

Layout motion_layout(uint32_t height, uint32_t width) {
    return {kComponents * kGaps, (height + kCell - 1) / kCell, (width + kCell - 1) / kCell,
            kComponents};
}

void record_motion(Program& program, const Tensor& logarithms, const Tensor& moved,
                   const Tensor& channels) {
    const Layout& frames = logarithms.layout();
    const Layout cells = motion_layout(2 * frames.height, 2 * frames.width);
    const Layout& field = moved.layout();
    require_shapes(frames.channels == prior_windows + 1 && frames.block == 1 &&
                       is_dense(logarithms) &&
                       has_shape(moved, cells.channels, cells.height, cells.width) &&
                       field.block == cells.block && is_dense(moved) &&
                       has_shape(channels, kComponents * anchor_count, cells.height, cells.width),
                   "motion", {logarithms, moved, channels});
    const Tensor smooth =
        record_smooth(program, {.weights = {0.5F, 0.25F}, .reach = 1}, logarithms);
    const Tensor slopes = record_slopes(program, smooth);
    const SmoothDesc binomial{.weights = {0.375F, 0.25F, 0.0625F}, .reach = 2, .zero = true};
    SmoothDesc wide = binomial;
    wide.step = 2;
    const Tensor moments = record_moments(program, smooth, cells);
    record_solve(program, record_smooth(program, wide, record_smooth(program, binomial, moments)),
                 moved, true);
    for (uint32_t round = 0; round < motion_rounds; ++round) {
        const Tensor rest = record_round(program, slopes, moved);
        record_solve(program, record_smooth(program, binomial, rest), moved, false);
    }

    Dispatch dispatch =
        make(program, "motion_velocity", {}, {read(moved), update(channels)}, sizeof(VelocityPush));
    dispatch.set_push(
        VelocityPush{PushLayout(channels), origin(moved, kComponents), cells.width, cells.height});
    dispatch.groups = pixel_groups(cells, anchor_count);
    program.add(std::move(dispatch));
}

} // namespace ecir
