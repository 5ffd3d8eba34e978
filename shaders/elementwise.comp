#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// One operation on every element of tensors of one shape:
//     OP 0: result = 1 / (1 + exp(-a))      OP 1: result = a b      OP 2: result = a + b
//     OP 3: result = max(a + b, 0)
//
// a, b       any layout of the result's block; b is not read by OP 0; its plane stride is 0 where one channel
//            serves all (block 1)
// result     may be a or b; the halo and what fills up the last block are left alone
// Bindings: 0 a, 1 b, 2 result.
// Precondition: width block <= 64 SPAN groups.x, height = groups.y, one block of channels a groups.z.
// Tile: a row of one block, width x block consecutive elements: SPAN an invocation, 64 apart, so that
// the 64 of a workgroup read neighbours.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint OP = 0;
layout(constant_id = 1) const uint SPAN = 4;

layout(std430, binding = 0) readonly buffer A { float a[]; };
layout(std430, binding = 1) readonly buffer B { float b[]; };
layout(std430, binding = 2) writeonly buffer Result { float result[]; };

layout(push_constant) uniform Push {
    TensorLayout a_layout;
    TensorLayout b_layout;
    TensorLayout result_layout;
    uint width;
    uint channels;
};

void main() {
    const uint block = result_layout.block;
    const uint first = gl_WorkGroupID.z * block;
    const uint y = gl_WorkGroupID.y;
    const uint a_row = element(a_layout, first, y, 0);
    const uint b_row = element(b_layout, first, y, 0);
    const uint result_row = element(result_layout, first, y, 0);
    for (uint part = 0; part < SPAN; ++part) {
        const uint i = (gl_WorkGroupID.x * SPAN + part) * 64 + gl_LocalInvocationID.x;
        if (i < width * block && first + (i & (block - 1)) < channels) {
            const float value = a[a_row + i];
            float outcome;
            if (OP == 0) {
                outcome = 1.0 / (1.0 + exp(-value));
            } else if (OP == 1) {
                outcome = value * b[b_row + i];
            } else {
                outcome = value + b[b_row + i];
                if (OP == 3) {
                    outcome = max(outcome, 0);
                }
            }
            result[result_row + i] = outcome;
        }
    }
}
