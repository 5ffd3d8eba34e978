#version 460
// A convolution, 1x1 of stride 1, 3x3 of stride 1 or 2, or 5x5 of stride 2, for drivers that run on a CPU
// (lavapipe), on tensors by rows:
//
//   out[o][y][x] = max(floor, init[o][y][x] + bias[o]
//                             + sum over i < C, ky, kx < K of  w[o][i][ky][kx] in[i][S y + ky][S x + kx])
//
// A layer with many input channels takes several, each starting from what the one before wrote. Host side:
// layers/conv_row.cpp.
//
// Two output rows at once take fewer multiplications than one after the other (Winograd's F(2, 3) down the
// columns, Cook-Toom's F(2, 2)); 1x1 takes the plain two. With rows d of the input and g of the kernel, two
// rows of 3 taps are
//   y0 = (d0 - d2) g0 + (d1 + d2) (g0 + g1 + g2) / 2 + (d2 - d1) (g0 - g1 + g2) / 2
//   y1 =                (d1 + d2) (g0 + g1 + g2) / 2 - (d2 - d1) (g0 - g1 + g2) / 2 + (d3 - d1) g2
// and of 2 taps
//   y0 = (d0 - d1) g0 + d1 (g0 + g1),   y1 = d1 (g0 + g1) + (d2 - d1) g1.
// 3x3 S 1: 4 products instead of 6; S 2, even and odd rows apart: 3x3 5 instead of 6, 5x5 7 instead of 10.
// Products add up in `upper`, `both`, `apart` and `lower` until the end. The kernel's sums come ready in the
// weights. Rounding errors are like those of the direct sums, 4e-7 of the largest output at most in the cases
// of the operations table.
//
// What makes it fast there, measured on Mesa 22.3.6 on one core, against a lane an output channel
// (conv_lane.comp) in the fusion network at 240x180: 3x3 S 1 takes 0.38 to 0.53 of the time (50 to 57
// GFLOP/s of the plain sum), 5x5 S 2 0.78, 3x3 S 2 0.69 to 0.85.
// - a lane is a pixel: an input is a vector load, a weight an operand that the multiplication broadcasts;
// - 4 CB accumulators, CB = 4, hide the latency of additions; the code, run once from the first to the last
//   byte for each workgroup, should be short: with CB = 8 48 -> 48, 65 KB, runs at 49 instead of 65, and with
//   fewer inputs a pass networks take as long on Mesa 22.3.6 and 1.05 to 1.16 times as long on 25.0.7. Four
//   output rows at once (F(4, 3)) need half the products, but more additions and 6 CB accumulators: 54;
// - channels of a row follow each other at a distance that is a specialization constant, so that all loads
//   of a row need one address; with distances from push constants each load costs six instructions for
//   its address, and the layer takes 1.8 times as long. The pitch is of few values (row_pixels()), so that a
//   pipeline serves many layers and sizes;
// - weights come four a load: not faster, but the driver compiles in 0.7 instead of 2 s;
// - S 2: every second pixel out of two vectors by shuffles with known lanes, which LLVM turns into a join
//   and a truncation of 64-bit numbers; 5x5 16 -> 32 takes 7.2 ms, 12 ms with strided loads. Odd columns
//   out of the vectors that have the even ones take 14 ms, as LLVM keeps them all;
// - no load of a push constant behind a branch, where the driver does it lane by lane for each store: 3.2
//   instead of 4.9 ms for 3x3 32 -> 32 at 120x90;
// - workgroups follow each other along x, then by output channels, then down the image: the input rows of
//   all channels' sums stay in the cache, and a driver that cuts a dispatch in halves gives each core a half
//   of the image, which it has from the layer before; with channels last two cores take 1.11 times as long;
// - one pipeline with and without `init`, whose strides can be 0: a few per cent for half as many to compile.
//
// Layouts: in: by rows, in_address pointing at the corner of the first window; out: any of block 1; init:
//   block INIT, init_address pointing at pixel (0, 0) of channel 0, or zeros and strides 0; weights: per CB
//   output channels the bias [CB], then [i][kx][product][CB].
// Bindings: 0 out; everything else by address.
// Preconditions: `in` and `init` readable (any content) up to 2 LX S pixels past what they hold;
//   gl_WorkGroupID below 4096. Workgroup: LX pixels of two rows, CB output channels.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_shuffle : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int C = 32;
layout(constant_id = 2) const int K = 3;
layout(constant_id = 3) const int S = 1; // K 1: 1, K 5: 2
layout(constant_id = 4) const int PLANE = 144; // elements from a channel of `in` to the next
layout(constant_id = 5) const int INIT = 1;

const int CB = 4; // output channels

const int ROWS = S + K; // input rows of two output rows
const int PRODUCTS = K == 1 ? 2 : (S == 1 ? 4 : (K == 3 ? 5 : 7));

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
    uint width;
    uint height;
    float floor_;
    uint filler; // to whole 8 bytes, as the host has it
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

// Pixels S (x + lane) + kx of input row S y + r of channel i.
float load_in(uint x, uint y, int i, int r, int kx) {
    const uint row = min(S * y + r, in_last) * in_row;
    const uint64_t plane = uint64_t(i * PLANE) * 4ul;
    if (S == 1) {
        return load_row(in_address + uint64_t(row + x + kx) * 4ul + plane);
    }
    const uint64_t first = in_address + uint64_t(row + S * x + kx) * 4ul + plane;
    const uint from = S * gl_SubgroupInvocationID % LX;
    const float low = subgroupShuffle(load_row(first), from);
    const float high = subgroupShuffle(load_row(first + uint64_t(LX) * 4ul), from);
    return gl_SubgroupInvocationID < LX / 2 ? low : high;
}

void main() {
    const uint lane = gl_SubgroupInvocationID;
    const uint x = uniform_id(gl_WorkGroupID.x) * LX;
    const uint y = uniform_id(gl_WorkGroupID.z) * 2;
    const uint group = uniform_id(gl_WorkGroupID.y);
    Quads weight =
        Quads(weight_address + uint64_t(group * (CB * (1 + C * K * PRODUCTS))) * 4ul);

    float upper[CB], both[CB], apart[CB], lower[CB];
    [[unroll]] for (int c = 0; c < CB; ++c) {
        upper[c] = both[c] = apart[c] = lower[c] = 0.0;
    }
    [[unroll]] for (int i = 0; i < C; ++i) {
        [[unroll]] for (int kx = 0; kx < K; ++kx) {
            float d[7];
            [[unroll]] for (int r = 0; r < ROWS; ++r) {
                d[r] = load_in(x, y, i, r, kx);
            }
            float v[7];
            if (K == 1) {
                v = float[](d[0], d[1], 0, 0, 0, 0, 0);
            } else if (S == 1) {
                v = float[](d[0] - d[2], d[1] + d[2], d[2] - d[1], d[3] - d[1], 0, 0, 0);
            } else if (K == 3) {
                v = float[](d[0] - d[2], d[2], d[4] - d[2], d[1], d[3], 0, 0);
            } else {
                v = float[](d[0] - d[4], d[2] + d[4], d[4] - d[2], d[6] - d[2], d[1] - d[3], d[3],
                            d[5] - d[3]);
            }
            [[unroll]] for (int p = 0; p < PRODUCTS; ++p) {
                vec4 w;
                [[unroll]] for (int c = 0; c < CB; ++c) {
                    if (c % 4 == 0) {
                        w = weight.v[(((i * K + kx) * PRODUCTS + p) * CB + CB + c) / 4];
                    }
                    const float product = w[c % 4] * v[p];
                    if (K == 1) {
                        if (p == 0) {
                            upper[c] += product;
                        } else {
                            lower[c] += product;
                        }
                    } else if (S == 2 && K == 3) {
                        if (p == 0 || p == 3) {
                            upper[c] += product;
                        } else if (p == 1) {
                            both[c] += product;
                        } else {
                            lower[c] += product;
                        }
                    } else if (p == 0 || p == 4) {
                        upper[c] += product;
                    } else if (p == 1 || p == 5) {
                        both[c] += product;
                    } else if (p == 2) {
                        apart[c] += product;
                    } else {
                        lower[c] += product;
                    }
                }
            }
        }
    }
    // Push constants are read here: behind a branch the driver reads them lane by lane.
    const float least = floor_;
    const uint below[2] = {width, y + 1 < height ? width : 0};
    const uint target = out_origin + group * (CB * out_plane) + y * out_row + x + lane;
    const uint plane = out_plane;
    const uint next = out_row;
    const uint start = y * init_row + x * init_pixel;
    const uint start_next = y + 1 < height ? init_row : 0;
    [[unroll]] for (int c = 0; c < CB; ++c) {
        const float bias = weight.v[c / 4][c % 4];
        const uint channel = group * CB + c;
        const uint at = channel / INIT * init_plane + channel % INIT + start;
        const float first = load_lanes(init_address, at, INIT) + bias;
        const float second = load_lanes(init_address, at + start_next, INIT) + bias;
        upper[c] = max(both[c] + apart[c] + upper[c] + first, least);
        lower[c] = max(both[c] - apart[c] + lower[c] + second, least);
    }
    [[unroll]] for (int c = 0; c < CB; ++c) {
        [[unroll]] for (int t = 0; t < 2; ++t) {
            if (x + lane < below[t]) {
                out_[target + c * plane + t * next] = t == 0 ? upper[c] : lower[c];
            }
        }
    }
}
