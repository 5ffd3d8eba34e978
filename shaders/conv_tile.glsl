// A convolution over one input tensor for GPUs, by taps (for the meaning of OS and phases see conv_lane.comp):
//
//   out[o][OS y][OS x] = max(floor, start + sum over i, ky < KH, kx < KW of w[o][i][ky][kx] in[i][S y + ky][S x + kx])
//   start = init[o][y][x] (when has_init) + bias[o]
//
// A workgroup computes LX x LY PY pixels of 8 output channels. For 4 input channels at a time it loads what these
// pixels see of them, and the weights, into shared memory; what lies outside of what the image needs is 0 there, so
// that the loops over taps have no test. An invocation computes PY pixels of a column: each value that it takes from
// the tile serves all taps of its column (KH) and the pixels that see it, each weight, which is the same for the whole
// workgroup, PY pixels. At PY = 8, 3x3, that is 34 loads of 4 values for 768 multiply-adds. Neighbouring invocations
// read neighbouring vec4s: with S = 2 the even columns lie before the odd ones. PY is chosen by the layer: 8 where
// that leaves enough workgroups, less for small images.
// The loop over kx is not unrolled: its body, 128 PY KH multiply-adds, fits instruction caches at 5x5 too.
//
// HALF (conv_tile_half.comp): weights and tile are float16, half the shared memory and traffic, and two multiply-adds
// an instruction on most GPUs. Those of one kernel column and 4 channels (4 KH <= 20) are summed in float16, so that
// converting costs little (2 conversions for 8 KH multiply-adds), and added in float32: the rounding of a longer
// float16 sum grows with its length. Values beyond float16's range are clamped to it.
//
// Layouts: in, out, init: [C/block][rows][pitch][block], block 8 for out and init, XB (8 or 1) for in,
//   origins at channel 0 and the window's corner; weights [O/8][I][KH KW][8] with I padded to a
//   multiple of 8 by zeros; bias [O/8][8].
// Bindings: 0 in as vec4 (XB = 8), 1 in as float (XB = 1), 2 weights, 3 bias, 4 init, 5 out.
// Preconditions: padding channels of in finite; PY <= 8, with S = 2 <= 2, which keeps shared memory below 15 KiB.
// Workgroup: LX x LY = 16 x 4 invocations, two subgroups of 32; z is the block of output channels.
layout(local_size_x = 16, local_size_y = 4) in;
layout(constant_id = 0) const int KH = 3;
layout(constant_id = 1) const int KW = 3;
layout(constant_id = 2) const int S = 1;
layout(constant_id = 3) const int XB = 8;
layout(constant_id = 4) const int OS = 1;
layout(constant_id = 5) const int PY = 4;

const int LX = 16;
const int LY = 4;
const int SEEN = (PY - 1) * S + KH; // rows that an invocation sees
const int ROWS = (LY * PY - 1) * S + KH;
const int HALF_COLUMNS = LX + (KW - 1) / S; // of each remainder by S
const int COLUMNS = HALF_COLUMNS * S;
const int WEIGHTS = 4 * KH * KW * 2; // vec4s

layout(set = 0, binding = 0, std430) readonly buffer In4 { vec4 in4[]; };
layout(set = 0, binding = 1, std430) readonly buffer In1 { float in1[]; };
layout(set = 0, binding = 2, std430) readonly buffer Weights { VALUE4 w[]; };
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
    uint out_blocks; // of 8 channels; z has as many workgroups here
};

shared VALUE4 tile[ROWS * COLUMNS];
shared VALUE4 weight[WEIGHTS];

VALUE4 stored(vec4 value) {
#ifdef HALF
    return VALUE4(clamp(value, vec4(-65504.0), vec4(65504.0)));
#else
    return value;
#endif
}

// Channels first, ..., first + 3 at a place of the input.
vec4 input_values(uint first, uint at) {
    if (XB == 8) {
        return in4[(at + first / 8u * in_plane + (first & 4u)) / 4u];
    }
    vec4 value = vec4(0.0);
    [[unroll]] for (uint c = 0u; c < 4u; ++c) {
        if (first + c < channels) {
            value[c] = in1[at + (first + c) * in_plane];
        }
    }
    return value;
}

// What the workgroup needs of input channels first, ..., first + 3.
void load(uint first, uint group) {
    const uint left = gl_WorkGroupID.x * uint(LX * S);
    const uint top = gl_WorkGroupID.y * uint(LY * PY * S);
    const uint right = (width - 1u) * uint(S) + uint(KW); // where the input that counts ends
    const uint bottom = (height - 1u) * uint(S) + uint(KH);
    for (uint i = gl_LocalInvocationIndex; i < uint(ROWS * COLUMNS); i += uint(LX * LY)) {
        const uint row = i / uint(COLUMNS);
        const uint column = i % uint(COLUMNS);
        const uint x = left + column;
        const uint y = top + row;
        vec4 value = vec4(0.0);
        if (x < right && y < bottom) {
            value = input_values(first, in_origin + y * in_row + x * uint(XB));
        }
        const uint place = column % uint(S) * uint(HALF_COLUMNS) + column / uint(S);
        tile[row * uint(COLUMNS) + place] = stored(value);
    }
    const uint padded = (channels + 7u) / 8u * 8u;
    const uint start = (group * padded + first) * uint(KH * KW * 2);
    for (uint i = gl_LocalInvocationIndex; i < uint(WEIGHTS); i += uint(LX * LY)) {
        weight[i] = w[start + i];
    }
}

void main() {
    const uint group = gl_WorkGroupID.z;
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_GlobalInvocationID.y * uint(PY);
    vec4 low[PY];
    vec4 high[PY];
    [[unroll]] for (int p = 0; p < PY; ++p) {
        low[p] = bias[group * 2u];
        high[p] = bias[group * 2u + 1u];
        if (has_init != 0u && x < width && y + p < height) {
            const uint at = (init_origin + group * init_plane + (y + p) * init_row + x * (8u * OS)) / 4u;
            low[p] += init4[at];
            high[p] += init4[at + 1u];
        }
    }
    for (uint first = 0u; first < channels; first += 4u) {
        barrier(); // nobody reads the tile before this one any more
        load(first, group);
        barrier();
        for (int kx = 0; kx < KW; ++kx) {
            const int place = kx % S * HALF_COLUMNS + kx / S + int(gl_LocalInvocationID.x);
            const int row = int(gl_LocalInvocationID.y) * PY * S;
            VALUE4 seen[SEEN];
            [[unroll]] for (int r = 0; r < SEEN; ++r) {
                seen[r] = tile[(row + r) * COLUMNS + place];
            }
#ifdef HALF
            VALUE4 sum_low[PY];
            VALUE4 sum_high[PY];
            [[unroll]] for (int p = 0; p < PY; ++p) {
                sum_low[p] = VALUE4(0.0);
                sum_high[p] = VALUE4(0.0);
            }
#else
#define sum_low low
#define sum_high high
#endif
            [[unroll]] for (int ky = 0; ky < KH; ++ky) {
                [[unroll]] for (int c = 0; c < 4; ++c) {
                    const int tap = ((c * KH + ky) * KW + kx) * 2;
                    const VALUE4 w_low = weight[tap];
                    const VALUE4 w_high = weight[tap + 1];
                    [[unroll]] for (int p = 0; p < PY; ++p) {
                        sum_low[p] += w_low * seen[p * S + ky][c];
                        sum_high[p] += w_high * seen[p * S + ky][c];
                    }
                }
            }
#ifdef HALF
            [[unroll]] for (int p = 0; p < PY; ++p) {
                low[p] += vec4(sum_low[p]);
                high[p] += vec4(sum_high[p]);
            }
#endif
        }
    }
    [[unroll]] for (int p = 0; p < PY; ++p) {
        if (x < width && y + p < height) {
            const uint at = (out_origin + group * out_plane + (y + p) * out_row + x * (8u * OS)) / 4u;
            out4[at] = max(low[p], vec4(floor_));
            out4[at + 1u] = max(high[p], vec4(floor_));
        }
    }
}
