#include "layers/edi_moments.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <string>

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/edi_counts.comp.
struct CountPush {
    uint32_t counts_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t sensor_width = 0;
};
static_assert(sizeof(CountPush) == 16);

/// Mirrors the push constants of shaders/edi_level.comp.
struct LevelPush {
    uint32_t blurry_origin = 0;
    uint32_t level_origin = 0;
    uint32_t width = 0;
    uint32_t sensor_width = 0;
};
static_assert(sizeof(LevelPush) == 16);

/// Mirrors the push constants of shaders/edi_filter.comp.
struct FilterPush {
    uint32_t from_origin = 0;
    uint32_t to_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t samples = 0;
};
static_assert(sizeof(FilterPush) == 20);

/// Mirrors the push constants of shaders/edi_moments.comp.
struct MomentPush {
    uint32_t fields_origin = 0;
    uint32_t level_origin = 0;
    uint32_t moments_origin = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t tile_columns = 0;
    uint32_t tiles = 0;
};
static_assert(sizeof(MomentPush) == 28);

constexpr uint32_t largest_side = 480;
constexpr uint32_t margin = 2; // of a derivative's reach

/// What the kernels take for granted.
namespace shader {
using uint = uint32_t;
#include "shaders/edi_sampling.glsl"
static_assert(WINDOWS == edi_windows && WINDOW_LENGTH / 256.0 == edi_window_length);
static_assert(WINDOW_FIRST / 256.0 - 1 == edi_window_start(0) &&
              (WINDOW_FIRST + WINDOW_SPACING) / 256.0 - 1 == edi_window_start(1));
static_assert(STEP == edi_sample_step && SAMPLES == edi_tile_samples);
} // namespace shader

uint32_t sample_count(uint32_t pixels) {
    return (pixels - 2 * margin + edi_sample_step - 1) / edi_sample_step;
}

/// Sizes of an input that fits its own event offsets.
EdiMomentShape checked_shape(const EdiInput& input) {
    const Layout& blurry = input.blurry.layout();
    require_shapes(blurry.channels == 1 && is_dense(input.blurry) && blurry.block == 1 &&
                       input.offsets.layout().elements() ==
                           uint64_t{blurry.width} * blurry.height + 1 &&
                       input.times.layout().width == input.marks.layout().width &&
                       input.thresholds.layout().elements() == 2,
                   "EDI moments", {input.offsets, input.times, input.marks, input.blurry});
    return edi_moment_shape(blurry.width, blurry.height);
}

uint32_t busy_events(const EdiMomentShape& shape) {
    return edi_busy_events / (shape.bin * shape.bin);
}

/// Adds a dispatch whose bytes are those of its tensors.
void add(Program& program, const char* shader, const char* label,
         std::span<const uint32_t> constants, std::vector<Argument> arguments, const auto& push,
         std::array<uint32_t, 3> groups, double flops) {
    Dispatch dispatch;
    dispatch.kernel = &program.device().kernel(
        shader, constants, static_cast<uint32_t>(arguments.size()), sizeof(push));
    for (const Argument& argument : arguments) {
        dispatch.bytes += static_cast<double>(argument.tensor.bytes());
    }
    dispatch.arguments = std::move(arguments);
    dispatch.set_push(push);
    dispatch.groups = groups;
    dispatch.flops = flops;
    dispatch.label = label;
    program.add(std::move(dispatch));
}

/// shaders/edi_level.comp; `still` for ln(B + e) alone.
void record_level(Program& program, const EdiInput& input, const EdiMomentShape& shape, bool still,
                  const Tensor& level) {
    const std::array<uint32_t, 3> constants = {shape.bin, busy_events(shape), still ? 1U : 0U};
    const auto events = static_cast<double>(input.marks.layout().elements());
    add(program, "edi_level", "edi_level", constants,
        {read(input.offsets), read(input.times), read(input.marks), read(input.blurry),
         read(input.thresholds), write(level)},
        LevelPush{origin(input.blurry), origin(level), shape.width, input.blurry.layout().width},
        pixel_groups(level.layout()), still ? 0 : 20 * events);
}

/// shaders/edi_filter.comp.
void record_filter(Program& program, const Tensor& from, bool slope, bool vertical,
                   const Tensor& to) {
    const Layout& layout = from.layout();
    const std::array<uint32_t, 2> constants = {slope ? 1U : 0U, vertical ? 1U : 0U};
    const uint32_t samples = vertical ? to.layout().height : to.layout().width;
    const uint32_t lines = vertical ? layout.width : layout.height;
    add(program, "edi_filter", "edi_filter", constants, {read(from), write(to)},
        FilterPush{origin(from), origin(to), layout.width, layout.height, samples},
        {ceil_div(lines, 64), ceil_div(samples, shader::RUN), layout.channels},
        (slope ? 26.0 : 18.0) * static_cast<double>(to.layout().elements()));
}

/// The samples of smoothed frames.
void record_values(Program& program, const Tensor& frames, const EdiMomentShape& shape,
                   const Tensor& values) {
    const Layout& layout = frames.layout();
    const Tensor across = program.temporary({layout.channels, layout.height, shape.columns});
    record_filter(program, frames, false, false, across);
    record_filter(program, across, false, true, values);
}

/// The samples of their derivatives: first those by x of all frames, then those by y.
void record_slopes(Program& program, const Tensor& frames, const EdiMomentShape& shape,
                   const Tensor& slopes) {
    const Layout& layout = frames.layout();
    for (const bool vertical : {false, true}) {
        const Tensor across = program.temporary({layout.channels, layout.height, shape.columns});
        record_filter(program, frames, !vertical, false, across);
        record_filter(program, across, vertical, true,
                      slopes.channels(vertical ? layout.channels : 0, layout.channels));
    }
}

} // namespace

EdiMomentShape edi_moment_shape(uint32_t width, uint32_t height) {
    if (std::min(width, height) < edi_smallest_side) {
        throw Error(ExitCode::bad_input, "thresholds cannot be estimated from " +
                                             std::to_string(width) + "x" + std::to_string(height) +
                                             " pixels; at least 16x16 are needed");
    }
    EdiMomentShape shape{};
    // A long strip keeps its short side.
    shape.bin = std::max(1U, std::min(ceil_div(std::max(width, height), largest_side),
                                      std::min(width, height) / edi_smallest_side));
    shape.width = width / shape.bin;
    shape.height = height / shape.bin;
    shape.columns = sample_count(shape.width);
    shape.rows = sample_count(shape.height);
    shape.tile_columns = ceil_div(shape.columns, edi_tile_samples);
    shape.tile_rows = ceil_div(shape.rows, edi_tile_samples);
    return shape;
}

void record_edi_fields(Program& program, const EdiInput& input, const Tensor& fields) {
    const EdiMomentShape shape = checked_shape(input);
    const Layout wanted = shape.fields();
    require_shapes(has_shape(fields, wanted.channels, wanted.height, wanted.width) &&
                       is_dense(fields),
                   "EDI fields", {input.blurry, fields});
    // In the windows of N+ and N-, then in the middle of them, and b.
    const Tensor frames = program.temporary({4 * edi_windows + 1, shape.height, shape.width});
    const Tensor counts = frames.channels(0, 4 * edi_windows);
    const std::array<uint32_t, 2> constants = {shape.bin, busy_events(shape)};
    add(program, "edi_counts", "edi_counts", constants,
        {read(input.offsets), read(input.times), read(input.marks), write(counts)},
        CountPush{origin(counts), shape.width, shape.height, input.blurry.layout().width},
        pixel_groups(counts.layout()),
        6.0 * edi_windows * static_cast<double>(input.marks.layout().elements()));
    record_level(program, input, shape, true, frames.channels(4 * edi_windows, 1));

    constexpr uint32_t changes = 2 * edi_windows;
    constexpr uint32_t sloped = 2 * edi_windows + 1;
    record_values(program, frames.channels(0, changes), shape, fields.channels(0, changes));
    record_slopes(program, frames.channels(changes, sloped), shape,
                  fields.channels(changes, 2 * sloped));
}

void record_edi_moments(Program& program, const EdiInput& input, const Tensor& fields,
                        const Tensor& moments) {
    const EdiMomentShape shape = checked_shape(input);
    require_shapes(fields.layout().elements() == shape.fields().elements() &&
                       moments.layout().elements() == shape.moments().elements(),
                   "EDI moments", {input.blurry, fields, moments});
    const Tensor level = program.temporary({1, shape.height, shape.width});
    record_level(program, input, shape, false, level);
    const Tensor slopes = program.temporary({2, shape.rows, shape.columns});
    record_slopes(program, level, shape, slopes);
    const std::array<uint32_t, 1> constants = {std::bit_cast<uint32_t>(edi_motion_ridge)};
    const double samples = 1.0 * shape.columns * shape.rows * edi_windows;
    add(program, "edi_moments", "edi_moments", constants,
        {read(fields), read(slopes), read(input.thresholds), write(moments)},
        MomentPush{origin(fields), origin(slopes), origin(moments), shape.columns, shape.rows,
                   shape.tile_columns, shape.tiles()},
        {ceil_div(shape.tiles(), 64), edi_windows, 1}, 125 * samples);
}

} // namespace ecir
