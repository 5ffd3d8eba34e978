// A convolution over one input tensor by cooperative matrices, for GPUs that have them; factors in float16,
// sums in float32 (for the meaning of OS and phases see conv_lane.comp):
//
//   out[o][OS y][OS x] = max(floor, start + sum over i, ky < KH, kx < KW of w[o][i][ky][kx] in[i][S y + ky][S x + kx])
//   start = init[o][y][x] (when has_init) + bias[o]
//
// A tap is a product of matrices: M neighbouring pixels of a row x K input channels, times K x N output channels.
// A workgroup is LINES subgroups, one below the other, of PY rows of M pixels each, and computes RN N output
// channels of them. For K input channels at a time it loads what its pixels see of them into shared memory, as
// float16, a pixel's channels side by side; what lies outside of what the image needs is 0 there. A matrix of pixels
// starts at any pixel of the tile, so that no product needs its input copied together (im2col): with S = 2 the even
// columns lie before the odd ones. Each matrix that a subgroup takes from the tile serves all taps of its column (KH)
// and RN matrices of weights, which come straight from their buffer, one after the other, the same for all subgroups:
// at PY = 4, 3x3, RN = 2 that is 12 loads for 24 products. At the end sums go through shared memory, whose rows are
// pixels, to where tensors have them.
//
// PITCH: 16 channels of neighbouring pixels are 48 bytes apart, not 32, so that 8 pixels lie in different banks.
// The same text is compiled for both forms of the extension, and the device's is taken.
//
// Layouts: in, out, init: [C/block][rows][pitch][block], block 8 for out and init, XB (8 or 1) for in,
//   origins at channel 0 and the window's corner; weights [O/N][I/K][KH KW][K][N] as float16, O and I padded
//   by zeros to multiples of RN N and K; bias [O], padded likewise.
// Bindings: 0 in as vec4 (XB = 8), 1 in as float (XB = 1), 2 weights, 3 bias, 4 init, 5 out.
// Preconditions: padding channels of in finite; M, N and K are 8 or 16, a shape that the device has for float16 factors
//   and float32 sums in subgroups; subgroups have SUBGROUP invocations, all of them.
// Workgroup: LINES SUBGROUP invocations; z is the block of RN N output channels.
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_memory_scope_semantics : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_EXT_shader_16bit_storage : require
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
layout(local_size_x_id = 10) in;
layout(constant_id = 0) const int KH = 3;
layout(constant_id = 1) const int KW = 3;
layout(constant_id = 2) const int S = 1;
layout(constant_id = 3) const int XB = 8;
layout(constant_id = 4) const int OS = 1;
layout(constant_id = 5) const int PY = 4;
layout(constant_id = 6) const int M = 16;
layout(constant_id = 7) const int N = 16;
layout(constant_id = 8) const int K = 16;
layout(constant_id = 9) const int RN = 2;

const int LINES = 4;
const int SEEN = (PY - 1) * S + KH; // rows that a subgroup sees
const int ROWS = (LINES * PY - 1) * S + KH;
const int PART_COLUMNS = M + (KW - 1) / S; // of each remainder by S
const int COLUMNS = PART_COLUMNS * S;
const int PITCH = K == 16 ? 3 : 1; // 8 channels each, and what keeps pixels apart

layout(set = 0, binding = 0, std430) readonly buffer In4 { vec4 in4[]; };
layout(set = 0, binding = 1, std430) readonly buffer In1 { float in1[]; };
layout(set = 0, binding = 2, std430) readonly buffer Weights { uvec4 w[]; };
layout(set = 0, binding = 3, std430) readonly buffer Bias { float bias[]; };
layout(set = 0, binding = 4, std430) readonly buffer Init { float init1[]; };
layout(set = 0, binding = 5, std430) writeonly buffer Out { float out1[]; };
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
    uint out_blocks; // of 8 channels
};

shared uvec4 tile[ROWS * COLUMNS * PITCH];
shared float sums[LINES * M * N];

uvec4 packed(vec4 low, vec4 high) {
    const vec4 a = clamp(low, vec4(-65504.0), vec4(65504.0));
    const vec4 b = clamp(high, vec4(-65504.0), vec4(65504.0));
    return uvec4(packFloat2x16(f16vec2(a.xy)), packFloat2x16(f16vec2(a.zw)),
                 packFloat2x16(f16vec2(b.xy)), packFloat2x16(f16vec2(b.zw)));
}

// Channels first, ..., first + 7 at a place of the input.
uvec4 input_values(uint first, uint at) {
    if (XB == 8) {
        const uint from = (at + first / 8u * in_plane) / 4u;
        return packed(in4[from], in4[from + 1u]);
    }
    vec4 low = vec4(0.0);
    vec4 high = vec4(0.0);
    [[unroll]] for (uint c = 0u; c < 4u; ++c) {
        if (first + c < channels) {
            low[c] = in1[at + (first + c) * in_plane];
        }
        if (first + c + 4u < channels) {
            high[c] = in1[at + (first + c + 4u) * in_plane];
        }
    }
    return packed(low, high);
}

// What the workgroup needs of input channels first, ..., first + K - 1.
void load(uint first) {
    const uint left = gl_WorkGroupID.x * uint(M * S);
    const uint top = gl_WorkGroupID.y * uint(LINES * PY * S);
    const uint right = (width - 1u) * uint(S) + uint(KW); // where the input that counts ends
    const uint bottom = (height - 1u) * uint(S) + uint(KH);
    const uint parts = uint(K / 8);
    for (uint i = gl_LocalInvocationIndex; i < uint(ROWS * COLUMNS) * parts; i += gl_WorkGroupSize.x) {
        const uint part = i % parts;
        const uint row = i / parts / uint(COLUMNS);
        const uint column = i / parts % uint(COLUMNS);
        const uint x = left + column;
        const uint y = top + row;
        uvec4 value = uvec4(0u);
        if (x < right && y < bottom && first + part * 8u < channels) {
            value = input_values(first + part * 8u, in_origin + y * in_row + x * uint(XB));
        }
        const uint place = column % uint(S) * uint(PART_COLUMNS) + column / uint(S);
        tile[(row * uint(COLUMNS) + place) * uint(PITCH) + part] = value;
    }
}

void main() {
    const uint line = gl_SubgroupID;
    SUMS sum[PY * RN];
    [[unroll]] for (int i = 0; i < PY * RN; ++i) {
        sum[i] = SUMS(0.0);
    }
    const uint slices = (channels + uint(K) - 1u) / uint(K);
    const uint matrix = uint(K * N / 8); // uvec4s of a matrix of weights
    for (uint slice = 0u; slice < slices; ++slice) {
        barrier(); // nobody reads the tile before this one any more
        load(slice * uint(K));
        barrier();
        for (int kx = 0; kx < KW; ++kx) {
            const uint place = uint(kx % S * PART_COLUMNS + kx / S);
            PIXELS seen[SEEN];
            [[unroll]] for (int r = 0; r < SEEN; ++r) {
                const uint row = line * uint(PY * S) + uint(r);
                LOAD(seen[r], tile, (row * uint(COLUMNS) + place) * uint(PITCH), uint(PITCH));
            }
            [[unroll]] for (int ky = 0; ky < KH; ++ky) {
                [[unroll]] for (int n = 0; n < RN; ++n) {
                    const uint group = gl_WorkGroupID.z * uint(RN) + uint(n);
                    const uint tap = (group * slices + slice) * uint(KH * KW) + uint(ky * KW + kx);
                    WEIGHTS weights;
                    LOAD(weights, w, tap * matrix, uint(N / 8));
                    [[unroll]] for (int p = 0; p < PY; ++p) {
                        sum[p * RN + n] = MULTIPLY_ADD(seen[p * S + ky], weights, sum[p * RN + n]);
                    }
                }
            }
        }
    }
    const uint mine = line * uint(M * N);
    [[unroll]] for (int p = 0; p < PY; ++p) {
        [[unroll]] for (int n = 0; n < RN; ++n) {
            barrier(); // nobody reads the sums before these any more
            STORE(sum[p * RN + n], sums, mine, uint(N));
            barrier();
            const uint y = (gl_WorkGroupID.y * uint(LINES) + line) * uint(PY) + uint(p);
            const uint channel = (gl_WorkGroupID.z * uint(RN) + uint(n)) * uint(N);
            for (uint i = gl_SubgroupInvocationID; i < uint(M * N); i += gl_SubgroupSize) {
                // Neighbouring invocations write neighbouring values: 8 channels of a pixel, then its neighbours.
                const uint block = i / uint(M * 8);
                const uint pixel = i / 8u % uint(M);
                const uint x = gl_WorkGroupID.x * uint(M) + pixel;
                const uint plane = channel / 8u + block;
                if (x >= width || y >= height || plane >= out_blocks) {
                    continue;
                }
                const uint c = i % 8u;
                float value = sums[mine + pixel * uint(N) + block * 8u + c] + bias[plane * 8u + c];
                if (has_init != 0u) {
                    value += init1[init_origin + plane * init_plane + y * init_row + x * uint(8 * OS) + c];
                }
                out1[out_origin + plane * out_plane + y * out_row + x * uint(8 * OS) + c] = max(value, floor_);
            }
        }
    }
}
