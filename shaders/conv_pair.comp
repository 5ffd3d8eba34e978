#version 460
// Two 3x3 convolutions in one, for drivers that run on a CPU (lavapipe): all but the last sum of
//
//   hidden[o][y][x] = max(0, start[o][y][x] + sum over i, ky, kx of w1[o][i][ky][kx] in[i][y + ky - 1][x + kx - 1])
//   out[y][x]       = sum over o, ky, kx of w2[o][ky][kx] hidden[o][y + ky - 1][x + kx - 1]
//
// namely planes[k][y][x] (+)= sum over o < H of w2[o][k] hidden[o][y][x] for the 9 taps k = 3 ky + kx, which
// shaders/plane_sum.comp adds up, each shifted by its tap. A layer takes H hidden channels a dispatch, all
// input channels at once. Host side: layers/conv_pair.cpp.
//
// What makes it fast there, measured on Mesa 22.3.6 with 9 -> 32 -> 1 channels at 240x180 on one core, 5.3 ms
// against 12.2 ms for the hidden channels through memory with a lane an output channel (conv_lane.comp):
// - a lane is a pixel, so the sums over hidden channels stay in the lane and hidden values in registers;
// - the input comes by load_lanes(), and a weight is an operand that the multiplication broadcasts: there
//   are no other instructions than a multiplication and an addition for each tap, and one load for CB;
// - CB = 4 hidden channels at a time hide the latency of additions (2: 1.2 times as long) and fit in
//   registers (8: 1.6 times);
// - one vector of pixels a lane: with two, weights used twice are loaded early, spilled and loaded again
//   (1.4 to 2 times as long); and the code, run once from the first to the last byte for each workgroup,
//   should be short, hence also the limit on H: 40 KB take 0.8 cycles a multiply-add, 80 KB 1.1.
//
// Layouts: in, planes: block 1, the in_address pointing at (-1, -1) of channel 0, planes_origin at (0, 0);
//   weights: for each CB hidden channels [i][ky][kx][CB], then [CB][9]; start: [H/SB][rows][pitch][SB],
//   start_address pointing at (0, 0) of the block of the first hidden channel.
// Bindings: 0 planes; everything is read by address (planes too, with ACCUMULATE). Columns from `width` to
//   the end of the last tile are written as zeros.
// Preconditions: `in` and `start` readable (any content) up to LX pixels past their last row; planes has
//   room for whole tiles; gl_WorkGroupID.x and .y below 4096. Workgroup: one tile of LX pixels of one row.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int C = 9;
layout(constant_id = 2) const int H = 32; // a multiple of CB
layout(constant_id = 3) const int SB = 0; // 0: no start
layout(constant_id = 4) const int SKIP = 0; // of the start's first block: its channels before
layout(constant_id = 5) const int ACCUMULATE = 0;

const int CB = 4;

layout(set = 0, binding = 0, std430) writeonly buffer Planes { float planes[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t in_address;
    uint64_t weight_address;
    uint64_t start_address;
    uint64_t planes_address;
    uint in_row; // elements
    uint in_plane;
    uint start_row;
    uint start_plane;
    uint planes_origin; // in the binding
    uint planes_row;
    uint planes_plane;
    uint width;
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

void main() {
    const uint lane = gl_SubgroupInvocationID;
    const uint x = uniform_id(gl_WorkGroupID.x) * LX;
    const uint y = uniform_id(gl_WorkGroupID.y);
    Source weight = Source(weight_address);

    float value[C * 9];
    [[unroll]] for (int i = 0; i < C; ++i) {
        [[unroll]] for (int k = 0; k < 9; ++k) {
            value[i * 9 + k] =
                load_lanes(in_address, i * in_plane + (y + k / 3) * in_row + x + k % 3, 1);
        }
    }
    float tap[9];
    [[unroll]] for (int k = 0; k < 9; ++k) {
        tap[k] = ACCUMULATE == 0
                     ? 0.0
                     : load_lanes(planes_address, k * planes_plane + y * planes_row + x, 1);
    }
    [[unroll]] for (int o = 0; o < H; o += CB) {
        const int first = o * (C * 9 + 9);
        float sum[CB];
        [[unroll]] for (int c = 0; c < CB; ++c) {
            sum[c] = 0.0;
            if (SB != 0) {
                const int block = max(SB, 1);
                const int channel = SKIP + o + c;
                sum[c] = load_lanes(start_address,
                                    (channel / block) * start_plane + y * start_row + x * block +
                                        channel % block,
                                    block);
            }
        }
        [[unroll]] for (int n = 0; n < C * 9; ++n) {
            [[unroll]] for (int c = 0; c < CB; ++c) {
                sum[c] += weight.v[first + n * CB + c] * value[n];
            }
        }
        [[unroll]] for (int c = 0; c < CB; ++c) {
            const float hidden = max(sum[c], 0.0);
            [[unroll]] for (int k = 0; k < 9; ++k) {
                tap[k] += weight.v[first + C * 9 * CB + c * 9 + k] * hidden;
            }
        }
    }
    const bool inside = x + lane < width;
    const uint target = planes_origin + y * planes_row + x + lane;
    [[unroll]] for (int k = 0; k < 9; ++k) {
        planes[target + k * planes_plane] = inside ? tap[k] : 0.0;
    }
}
