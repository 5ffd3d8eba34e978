#version 460
// One slice of a convolution for drivers that run on a CPU (lavapipe), by taps:
//
//   out[o][OS y][OS x] = max(floor, init[o][y][x] + bias[o]
//                            + sum over i < IB, ky < KH, kx < KW of  w[o][i][ky][kx] in[i][S y + ky][S x + kx])
//
// A layer is one or more such slices: input channels go IB at a time, each slice starting from what the
// one before wrote (init = out); a stride-2 transposed convolution is four ordinary ones, a sub-pixel
// phase each, with OS = 2. Host side: layers/conv.cpp.
//
// What makes it fast there, measured on Mesa 22.3.6 with a 5x5 stride-2 64 -> 128 layer:
// - a lane is an output channel and keeps PX pixels of one row as accumulators: with a lane a pixel it
//   takes 20 times as long; PX = 40 is 1.25 times as fast as PX = 20, since each workgroup starts, and
//   gathers its weights lane by lane, once for twice the pixels, though 40 no longer fit in registers;
// - everything is unrolled ([[unroll]], sizes are specialization constants), so accumulators stay in
//   registers; strides come from push constants at no cost, and one pipeline serves every image size;
// - the driver loads an address once for all lanes only if it is made of constants and push constants;
//   workgroup ids do not count, hence the detour through the table `digit` (16x without it);
// - weights come from a uniform buffer, two taps a 64-bit load, in the order in which they are used;
// - init and out go through storage buffers: by device address the same layer takes 1.3 times as long.
//
// Layouts: in, out, init: [C/block][rows][pitch][block], block LX for out and init, XB for in; in_address
//   and the origins point at the slice's first channel and the corner of the first window; weights: per
//   group of LX output channels [pair of taps][LX] x 2 floats, taps ordered (i, ky, kx); bias: [LX] a group.
// Bindings: 0 weights, a slice of at most 64 KiB (uniform, dynamic offset), 1 bias, 2 init, 3 out; in by
//   address.
// Preconditions: `in` readable (any content) up to PX S pixels past its last row; gl_WorkGroupID.x and .y
//   below 4096. Workgroup: one tile of PX pixels of one row, LX output channels.
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int PX = 20;
layout(constant_id = 2) const int IB = 8;
layout(constant_id = 3) const int KH = 3;
layout(constant_id = 4) const int KW = 3;
layout(constant_id = 5) const int S = 1;
layout(constant_id = 6) const int XB = 8;
layout(constant_id = 7) const int OS = 1;
layout(constant_id = 8) const int INIT = 1; // 0: starts from the bias alone

layout(buffer_reference, scalar) volatile readonly buffer Source { float v[]; };
layout(set = 0, binding = 0, scalar) uniform Weights { uint64_t w[8192]; };
layout(set = 0, binding = 1, std430) readonly buffer Bias { float bias[]; };
layout(set = 0, binding = 2, std430) readonly buffer Init { float init[]; };
layout(set = 0, binding = 3, std430) writeonly buffer Out { float out_[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t in_address;
    uint in_row;     // elements
    uint in_plane;
    uint out_origin;
    uint out_row;    // of this phase: OS rows of the tensor
    uint out_plane;
    uint bias_origin;
    uint init_origin;
    uint init_pixel;
    uint init_row;
    uint init_plane;
    uint width;      // output pixels a row in this phase
    float floor_;
    uint digit[8];   // 0, 1, ..., 7
};

uint uniform_id(uint id) {
    return digit[id & 7u] + 8u * digit[(id >> 3) & 7u] + 64u * digit[(id >> 6) & 7u] +
           512u * digit[(id >> 9) & 7u];
}

Source source(uint64_t address, uint element) {
    return Source(address + uint64_t(element) * 4ul);
}

void main() {
    const int kPairs = (IB * KH * KW + 1) / 2;
    const uint lane = gl_LocalInvocationID.x;
    const uint group = gl_WorkGroupID.z;
    const uint x = uniform_id(gl_WorkGroupID.x) * PX;
    const uint y = uniform_id(gl_WorkGroupID.y);
    const uint corner = y * (S * in_row) + x * (S * XB);
    const uint first_weight = group * (kPairs * LX) + lane;

    const uint start = init_origin + group * init_plane + y * init_row + x * init_pixel + lane;
    const float offset = bias[bias_origin + group * LX + lane];
    float sum[PX];
    [[unroll]] for (int p = 0; p < PX; ++p) {
        sum[p] = INIT == 0 ? offset : init[start + p * init_pixel] + offset;
    }
    [[unroll]] for (int i = 0; i < IB; ++i) {
        [[unroll]] for (int ky = 0; ky < KH; ++ky) {
            Source row = source(in_address, corner + (i / XB) * in_plane + ky * in_row);
            [[unroll]] for (int column = 0; column < (PX - 1) * S + KW; ++column) {
                const float value = row.v[column * XB + i % XB];
                [[unroll]] for (int kx = 0; kx < KW; ++kx) {
                    const int p = (column - kx) / S;
                    if (column >= kx && p * S == column - kx && p < PX) {
                        const int tap = (i * KH + ky) * KW + kx;
                        const vec2 pair =
                            uintBitsToFloat(unpackUint2x32(w[first_weight + (tap / 2) * LX]));
                        sum[p] += ((tap & 1) == 0 ? pair.x : pair.y) * value;
                    }
                }
            }
        }
    }
    const uint target = out_origin + group * out_plane + y * out_row + x * (OS * LX) + lane;
    const float least = floor_; // behind the branch the driver would read it lane by lane
    [[unroll]] for (int p = 0; p < PX; ++p) {
        if (x + p < width) {
            out_[target + p * (OS * LX)] = max(sum[p], least);
        }
    }
}
