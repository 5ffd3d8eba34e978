#version 450
// A convolution over one input tensor for GPUs, by taps (for the meaning of OS and phases see conv_lane.comp):
//
//   out[o][OS y][OS x] = max(floor, start + sum over i, ky < KH, kx < KW of w[o][i][ky][kx] in[i][S y + ky][S x + kx])
//   start = init[o][y][x] (when has_init) + bias[o]
//
// An invocation computes PX neighbouring pixels of one row for a block of 8 output channels, as 2 vec4
// a pixel: 16 weight loads, the same for the whole workgroup and so served by the cache, feed 64 PX
// multiply-adds.
//
// Layouts: in, out, init: [C/block][rows][pitch][block], block 8 for out and init, XB (8 or 1) for in,
//   origins at channel 0 and the window's corner; weights [O/8][I][KH KW][8] with I padded to a
//   multiple of 8 by zeros; bias [O/8][8].
// Bindings: 0 in as vec4 (XB = 8), 1 in as float (XB = 1), 2 weights, 3 bias, 4 init, 5 out.
// Preconditions: in readable PX S pixels past the last row's end is NOT needed: tiles are clipped.
// Workgroup: 8 x 8 invocations, 8 PX x 8 pixels; z is the block of output channels.
#extension GL_EXT_control_flow_attributes : require
layout(local_size_x = 8, local_size_y = 8) in;
layout(constant_id = 0) const int KH = 3;
layout(constant_id = 1) const int KW = 3;
layout(constant_id = 2) const int S = 1;
layout(constant_id = 3) const int XB = 8;
layout(constant_id = 4) const int OS = 1;

const int PX = 4;

layout(set = 0, binding = 0, std430) readonly buffer In4 { vec4 in4[]; };
layout(set = 0, binding = 1, std430) readonly buffer In1 { float in1[]; };
layout(set = 0, binding = 2, std430) readonly buffer Weights { vec4 w[]; };
layout(set = 0, binding = 3, std430) readonly buffer Bias { vec4 bias[]; };
layout(set = 0, binding = 4, std430) readonly buffer Init { vec4 init4[]; };
layout(set = 0, binding = 5, std430) writeonly buffer Out { vec4 out4[]; };
layout(push_constant) uniform Push {
    uint in_origin; // elements
    uint in_row;
    uint in_plane;
    uint out_origin;
    uint out_row;
    uint out_plane;
    uint init_origin;
    uint init_row;
    uint init_plane;
    uint channels; // of in
    uint width;    // of this phase
    uint height;
    uint has_init;
    float floor_;
};

void main() {
    const uint x = gl_GlobalInvocationID.x * PX;
    const uint y = gl_GlobalInvocationID.y;
    const uint group = gl_GlobalInvocationID.z;
    if (x >= width || y >= height) {
        return;
    }
    vec4 low[PX];
    vec4 high[PX];
    [[unroll]] for (int p = 0; p < PX; ++p) {
        low[p] = bias[group * 2u];
        high[p] = bias[group * 2u + 1u];
        if (has_init != 0u && x + p < width) {
            const uint at = (init_origin + group * init_plane + y * init_row + (x + p) * (8u * OS)) / 4u;
            low[p] += init4[at];
            high[p] += init4[at + 1u];
        }
    }
    const uint padded = (channels + 7u) / 8u * 8u;
    const uint corner = in_origin + y * S * in_row + x * (S * XB);
    for (uint first = 0u; first < padded; first += 8u) {
        for (int ky = 0; ky < KH; ++ky) {
            [[unroll]] for (int kx = 0; kx < KW; ++kx) {
                const uint tap = ((group * padded + first) * (KH * KW) + ky * KW + kx) * 2u;
                float value[PX][8];
                [[unroll]] for (int p = 0; p < PX; ++p) {
                    // The last tile of a row repeats its last pixel rather than read past the tensor.
                    const uint column = min(x + p, width - 1u) - x;
                    const uint at = corner + uint(ky) * in_row + (column * S + kx) * XB;
                    if (XB == 8) {
                        const uint quad = (at + first / 8u * in_plane) / 4u;
                        const vec4 a = in4[quad];
                        const vec4 b = in4[quad + 1u];
                        [[unroll]] for (int c = 0; c < 4; ++c) {
                            value[p][c] = a[c];
                            value[p][c + 4] = b[c];
                        }
                    } else {
                        [[unroll]] for (uint c = 0u; c < 8u; ++c) {
                            value[p][c] = first + c < channels ? in1[at + (first + c) * in_plane] : 0.0;
                        }
                    }
                }
                [[unroll]] for (int c = 0; c < 8; ++c) {
                    const vec4 w_low = w[tap + uint(c * KH * KW) * 2u];
                    const vec4 w_high = w[tap + uint(c * KH * KW) * 2u + 1u];
                    [[unroll]] for (int p = 0; p < PX; ++p) {
                        low[p] += w_low * value[p][c];
                        high[p] += w_high * value[p][c];
                    }
                }
            }
        }
    }
    [[unroll]] for (int p = 0; p < PX; ++p) {
        if (x + p < width) {
            const uint at = (out_origin + group * out_plane + y * out_row + (x + p) * (8u * OS)) / 4u;
            out4[at] = max(low[p], vec4(floor_));
            out4[at + 1u] = max(high[p], vec4(floor_));
        }
    }
}
