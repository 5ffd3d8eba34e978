#version 460
// A stride-2 transposed convolution, K = 3 or 5, for drivers that run on a CPU (lavapipe), on tensors by
// rows: each pixel in[i][y][x] adds w[i][o][ky][kx] in[i][y][x] to out[o][2 y + ky - K/2][2 x + kx - K/2], and
//
//   out = max(floor, init + bias + that sum)
//
// All four sub-pixel phases of LX columns of an input row at once: each input is loaded once, used K K times
// over the phases, and nothing is multiplied by zeros. A layer with many input channels takes several, each
// starting from what the one before wrote. Host side: layers/conv_row.cpp.
//
// What makes it fast is what does in shaders/conv_row.comp; the phases have 4 CB accumulators, and columns
// two apart cost stores nothing, which go lane by lane anyway. On Mesa 22.3.6 a 3x3 one takes 0.50 to 0.69 of
// the time of four dispatches of conv_lane.comp, with one pipeline instead of up to eight. Stores by
// device address: 2.3 times as long; of pairs of columns through a buffer of vec2: 0.93, not worth the
// alignment that they need.
//
// Layouts: in: by rows, in_address pointing at (-(K / 4), -(K / 4)) of channel 0; out: any of block 1; init:
//   block INIT, init_address pointing at pixel (0, 0) of channel 0; weights: per CB
//   output channels the bias [CB], then [i][ky][kx][CB].
// Bindings: 0 out; everything else by address.
// Preconditions: `in` and `init` readable (any content) up to 2 LX pixels past what they hold;
//   gl_WorkGroupID below 4096. Workgroup: 2 LX pixels of two output rows, CB output channels.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int C = 32;
layout(constant_id = 2) const int K = 3;
layout(constant_id = 3) const int PLANE = 144; // elements from a channel of `in` to the next
layout(constant_id = 4) const int INIT = 1; // 0: nothing to start from

const int CB = 4; // output channels

const int SIDE = (K + 1) / 2; // inputs that meet an output, along an axis, over all phases

layout(set = 0, binding = 0, std430) writeonly buffer Out { float out_[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t in_address;
    uint64_t weight_address;
    uint64_t init_address;
    uint in_row; // elements
    uint in_last; // row, counted from in_address
    uint init_pixel;
    uint init_row;
    uint init_plane;
    uint out_origin;
    uint out_row;
    uint out_plane;
    uint width; // of the output
    uint height;
    float floor_;
    uint filler; // to whole 8 bytes, as the host has it
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

void main() {
    const uint lane = gl_SubgroupInvocationID;
    const uint x = uniform_id(gl_WorkGroupID.x) * LX;
    const uint y = uniform_id(gl_WorkGroupID.z);
    const uint group = uniform_id(gl_WorkGroupID.y);
    Quads weight = Quads(weight_address + uint64_t(group * (CB * (1 + C * K * K))) * 4ul);

    float sum[4 * CB]; // [phase of the row][of the column][CB]
    [[unroll]] for (int n = 0; n < 4 * CB; ++n) {
        sum[n] = 0.0;
    }
    [[unroll]] for (int i = 0; i < C; ++i) {
        float d[SIDE * SIDE];
        [[unroll]] for (int n = 0; n < SIDE * SIDE; ++n) {
            const uint row = min(y + n / SIDE, in_last) * in_row;
            d[n] = load_row(in_address + uint64_t(row + x + n % SIDE) * 4ul +
                            uint64_t(i * PLANE) * 4ul);
        }
        [[unroll]] for (int ky = 0; ky < K; ++ky) {
            [[unroll]] for (int kx = 0; kx < K; ++kx) {
                // The tap goes to phase (p, q); from K / 4 before the output's input on come the d.
                const int p = (ky + K / 2) % 2;
                const int q = (kx + K / 2) % 2;
                const int n = ((p + K / 2 - ky) / 2 + K / 4) * SIDE + (q + K / 2 - kx) / 2 + K / 4;
                vec4 w;
                [[unroll]] for (int c = 0; c < CB; ++c) {
                    if (c % 4 == 0) {
                        w = weight.v[(((i * K + ky) * K + kx + 1) * CB + c) / 4];
                    }
                    sum[(p * 2 + q) * CB + c] += w[c % 4] * d[n];
                }
            }
        }
    }
    // Push constants are read here: behind a branch the driver reads them lane by lane.
    const float least = floor_;
    const uint below[2] = {width, 2 * y + 1 < height ? width : 0};
    const uint target =
        out_origin + group * (CB * out_plane) + 2 * y * out_row + 2 * (x + lane);
    const uint plane = out_plane;
    const uint next = out_row;
    const uint start = 2 * y * init_row + 2 * x * init_pixel;
    const uint start_next = 2 * y + 1 < height ? init_row : 0;
    [[unroll]] for (int c = 0; c < CB; ++c) {
        const float bias = weight.v[c / 4][c % 4];
        const uint channel = group * CB + c;
        const uint at = channel / max(INIT, 1) * init_plane + channel % max(INIT, 1) + start;
        [[unroll]] for (int phase = 0; phase < 4; ++phase) {
            float first = bias;
            if (INIT != 0) {
                first += load_lanes(
                    init_address, at + phase / 2 * start_next + phase % 2 * init_pixel, 2 * INIT);
            }
            sum[phase * CB + c] = max(sum[phase * CB + c] + first, least);
        }
    }
    [[unroll]] for (int c = 0; c < CB; ++c) {
        [[unroll]] for (int phase = 0; phase < 4; ++phase) {
            if (2 * (x + lane) + phase % 2 < below[phase / 2]) {
                out_[target + c * plane + phase / 2 * next + phase % 2] = sum[phase * CB + c];
            }
        }
    }
}
