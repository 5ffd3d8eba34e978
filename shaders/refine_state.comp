#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// What the residual networks read of frame z (layers/refine.hpp; algorithm 1, lines 5 and 8): planes
//     6 z      L             6 z + 1  dx L(y, x) = L(y, x - 1) - L(y, x), 0 for x = 0
//     6 z + 2  dy L(y, x) = L(y - 1, x) - L(y, x), 0 for y = 0
//     6 z + 3, 6 z + 4  positive and other events up to the next frame (z < intervals)
//
// frames, counts, state   block 1
// Bindings: 0 frames, 1 counts, 2 state.
// Precondition: width <= 64 x groups.x, height = groups.y, one frame a groups.z.
// Tile: one pixel of one frame an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Frames { float frames[]; };
layout(std430, binding = 1) readonly buffer Counts { float counts[]; };
layout(std430, binding = 2) writeonly buffer State { float state[]; };

layout(push_constant) uniform Push {
    TensorLayout frames_layout;
    TensorLayout counts_layout;
    TensorLayout state_layout;
    uint width;
    uint intervals; // 0: no counts
};

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const uint z = gl_WorkGroupID.z;
    if (x >= width) {
        return;
    }
    const uint at = element(frames_layout, z, y, x);
    const uint to = element(state_layout, 6 * z, y, x);
    const uint plane = state_layout.plane;
    const float value = frames[at];
    // 0 at the border, where the difference is one of the pixel and itself.
    state[to] = value;
    state[to + plane] = frames[at - min(x, 1)] - value;
    state[to + 2 * plane] = frames[at - min(y, 1) * frames_layout.row] - value;
    if (z < intervals) {
        state[to + 3 * plane] = counts[element(counts_layout, 2 * z, y, x)];
        state[to + 4 * plane] = counts[element(counts_layout, 2 * z + 1, y, x)];
    }
}
