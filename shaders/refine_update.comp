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
// initial    L0        frames     L, zeros around the image, neighbours of a frame beside it
// state      R_{i-1} is plane 6 i + 5 (layers/refine.hpp)
// updated    the new L
// All block 1 and of one row and plane stride; the origins point at (0, 0) of frame `first`.
// Precondition: width <= 64 x groups.x, height = groups.y, one frame a groups.z.
// Tile: one pixel of one frame an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Initial { float initial[]; };
layout(std430, binding = 1) readonly buffer Frames { float frames[]; };
layout(std430, binding = 2) readonly buffer State { float state[]; };
layout(std430, binding = 3) writeonly buffer Updated { float updated[]; };

layout(push_constant) uniform Push {
    uint initial_origin;
    uint frames_origin;
    uint state_origin;
    uint updated_origin;
    uint row;
    uint plane;
    uint width;
    uint first;
    uint last;
    float alpha[10]; // 3x3 weights by rows, bias
    float largest_step;
};

#include "refine_step.glsl"

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint z = gl_WorkGroupID.z;
    if (x >= width) {
        return;
    }
    const uint pixel = gl_WorkGroupID.y * row + x;
    const uint at = frames_origin + z * plane + pixel;
    float sum = alpha[9];
    [[unroll]] for (uint dy = 0; dy < 3; ++dy) {
        [[unroll]] for (uint dx = 0; dx < 3; ++dx) {
            sum += alpha[3 * dy + dx] * frames[at + dy * row + dx - row - 1];
        }
    }
    const uint before = min(first + z, 1);
    const uint after = min(last - first - z, 1);
    const uint residual = state_origin + (6 * z + 5) * plane + pixel;
    updated[updated_origin + z * plane + pixel] =
        refine_step(sum, largest_step, frames[at], initial[initial_origin + z * plane + pixel], before != 0,
                    frames[at - before * plane], state[residual], after != 0,
                    frames[at + after * plane], state[residual + after * 6 * plane]);
}
