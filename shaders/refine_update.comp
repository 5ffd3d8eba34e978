#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// One gradient step on equation 8 with lambda = 1 (algorithm 1, lines 13 to 15), i = first + z:
//     alpha_i = min(0.1 max(0, sum_{dy, dx} a(dy, dx) L_i(y + dy, x + dx) + bias), largest_step),
//               L_i = 0 outside the image
//     D_i     = 2 (L_i - L0_i) - 2 (L_{i-1} + R_{i-1} - L_i) [i > 0] + 2 (L_i + R_i - L_{i+1}) [i < last]
//     L_i    <- L_i - alpha_i D_i
// refine_update_lane.comp is the same for drivers that run on a CPU.
//
// initial    L0
// state      L_i is plane 6 i, zeros around the image, R_{i-1} plane 6 i + 5 (layers/refine.hpp)
// updated    the new L
// largest    [1]: becomes at least the largest change of a pixel, as a float's bits, which have its order
// All block 1 and of one row and plane stride; the origins point at (0, 0) of frame `first`.
// Precondition: width <= 64 x groups.x, height = groups.y, one frame a groups.z.
// Tile: one pixel of one frame an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Initial { float initial[]; };
layout(std430, binding = 1) readonly buffer State { float state[]; };
layout(std430, binding = 2) writeonly buffer Updated { float updated[]; };
layout(std430, binding = 3) buffer Largest { uint largest[]; };

layout(push_constant) uniform Push {
    uint initial_origin;
    uint state_origin;
    uint updated_origin;
    uint largest_origin;
    uint row;
    uint plane;
    uint width;
    uint first;
    uint last;
    float alpha[10]; // 3x3 weights by rows, bias
    float largest_step;
};

#include "refine_step.glsl"

shared uint largest_here;

// Takes the step of a pixel of frame first + z; returns how far that is.
float move(uint pixel, uint z) {
    const uint at = state_origin + 6 * z * plane + pixel;
    float sum = alpha[9];
    [[unroll]] for (uint dy = 0; dy < 3; ++dy) {
        [[unroll]] for (uint dx = 0; dx < 3; ++dx) {
            sum += alpha[3 * dy + dx] * state[at + dy * row + dx - row - 1];
        }
    }
    const uint before = min(first + z, 1);
    const uint after = min(last - first - z, 1);
    const uint residual = at + 5 * plane;
    const float value = state[at];
    const float result =
        refine_step(sum, largest_step, value, initial[initial_origin + z * plane + pixel], before != 0,
                    state[at - before * 6 * plane], state[residual], after != 0,
                    state[at + after * 6 * plane], state[residual + after * 6 * plane]);
    updated[updated_origin + z * plane + pixel] = result;
    return abs(result - value);
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint z = gl_WorkGroupID.z;
    if (gl_LocalInvocationIndex == 0) {
        largest_here = 0;
    }
    barrier();
    if (x < width) {
        atomicMax(largest_here, floatBitsToUint(move(gl_WorkGroupID.y * row + x, z)));
    }
    barrier();
    if (gl_LocalInvocationIndex == 0) {
        atomicMax(largest[largest_origin], largest_here);
    }
}
