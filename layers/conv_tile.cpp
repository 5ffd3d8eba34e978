#include <algorithm>
#include <array>
#include <limits>
#include <string>

#include "layers/conv.hpp"
#include "layers/shapes.hpp"

// Convolutions for GPUs: the tile family, by shared memory or by cooperative matrices.

namespace ecir {
namespace {

struct TilePush {
    uint32_t in_origin = 0;
    uint32_t in_row = 0;
    uint32_t in_plane = 0;
    uint32_t out_origin = 0;
    uint32_t out_row = 0;
    uint32_t out_plane = 0;
    uint32_t init_origin = 0;
    uint32_t init_row = 0;
    uint32_t init_plane = 0;
    uint32_t channels = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    uint32_t has_init = 0;
    float floor = 0;
    uint32_t out_blocks = 0;
};
static_assert(sizeof(TilePush) == 60);

constexpr uint32_t kTileColumns = 16; ///< of pixels, LX of shaders/conv_tile.glsl

/// Output rows of an invocation, or of a subgroup's matrices, `most` at most. The more the fewer
/// loads a multiply-add, but a large GPU wants some 256 workgroups before anything else.
uint32_t tile_rows(uint32_t height, uint32_t columns, uint32_t groups, uint32_t most) {
    constexpr uint32_t kEnough = 256;
    for (uint32_t rows = most; rows > 1; rows /= 2) {
        if (columns * ceil_div(height, conv_tile_lines * rows) * groups >= kEnough) {
            return rows;
        }
    }
    return 1;
}

} // namespace

uint32_t Conv::matrices_across() const {
    return desc_.out_channels > device_.info().matrices.n ? 2 : 1;
}

void Conv::record_tile(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                       const std::optional<Tensor>& residual) const {
    const Layout& out = output.layout();
    const Matrices& shape = device_.info().matrices;
    const uint32_t stride = desc_.transposed ? 1 : desc_.stride;
    const uint32_t tile_columns = matrices_ ? shape.m : kTileColumns;
    const uint32_t blocks =
        matrices_ ? ceil_div(desc_.out_channels, shape.n * matrices_across()) : groups();
    // What shared memory and registers hold.
    const uint32_t most_rows = matrices_ ? (stride == 1 ? 4 : 1) : (stride == 1 ? 8 : 2);
    std::string shader = precision_ == Precision::float16 ? "conv_tile_half" : "conv_tile";
    if (matrices_) {
        shader = "conv_matrix_" + std::string(form_name(shape.form));
    }
    for (size_t p = 0; p < phases_.size(); ++p) {
        const Phase& phase = phases_[p];
        if (out.height <= phase.offset_y || out.width <= phase.offset_x) {
            continue;
        }
        for (size_t i = 0; i < inputs.size(); ++i) {
            const Layout& in = inputs[i].layout();
            const bool accumulate = i > 0;
            const Tensor& init = accumulate ? output : residual.value_or(output);
            TilePush push;
            push.in_row = static_cast<uint32_t>(in.row_stride());
            push.in_plane = static_cast<uint32_t>(in.plane_stride());
            push.in_origin =
                PushLayout(inputs[i]).origin - phase.pad_y * push.in_row - phase.pad_x * in.block;
            push.out_origin = corner(output, phase);
            push.out_row = static_cast<uint32_t>(out.row_stride() * step());
            push.out_plane = static_cast<uint32_t>(out.plane_stride());
            push.init_origin = corner(init, phase);
            push.init_row = static_cast<uint32_t>(init.layout().row_stride() * step());
            push.init_plane = static_cast<uint32_t>(init.layout().plane_stride());
            push.channels = in.channels;
            push.width = ceil_div(out.width - phase.offset_x, step());
            push.height = ceil_div(out.height - phase.offset_y, step());
            push.has_init = accumulate || residual ? 1 : 0;
            push.floor =
                i + 1 == inputs.size() && desc_.relu ? 0 : std::numeric_limits<float>::lowest();
            push.out_blocks = groups();
            const uint32_t columns = ceil_div(push.width, tile_columns);
            const uint32_t rows = desc_.tile_rows != 0
                                      ? std::min(desc_.tile_rows, most_rows)
                                      : tile_rows(push.height, columns, blocks, most_rows);
            std::vector<uint32_t> constants{phase.kernel_h, phase.kernel_w, stride,
                                            in.block,       step(),         rows};
            if (matrices_) {
                constants.insert(constants.end(), {shape.m, shape.n, shape.k, matrices_across(),
                                                   conv_tile_lines * device_.info().subgroup_size});
            }
            Dispatch dispatch;
            dispatch.kernel = &device_.kernel(shader, constants, 6, sizeof(TilePush));
            dispatch.arguments = {ecir::read(inputs[i]),
                                  ecir::read(inputs[i]),
                                  constant(weights_, tile_offsets_[p][i]),
                                  constant(bias_, accumulate ? zeros_offset() : 0),
                                  ecir::read(init),
                                  update(output)};
            dispatch.set_push(push);
            dispatch.groups = {columns, ceil_div(push.height, conv_tile_lines * rows), blocks};
            const double outputs = double{1} * push.width * push.height * desc_.out_channels;
            dispatch.flops = 2.0 * outputs * in.channels * static_cast<double>(phase.taps.size());
            dispatch.bytes = 4.0 * (double{1} * in.height * in.width * in.channels +
                                    (accumulate ? 2 : 1) * outputs);
            dispatch.label = shader;
            program.add(std::move(dispatch));
        }
    }
}

} // namespace ecir
