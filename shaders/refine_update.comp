#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "tensor.glsl"

// One gradient step on equation 8 with lambda = 1 (algorithm 1, lines 13 to 15), i = first + z:
//     alpha_i = 0.1 max(0, sum_{dy, dx} a(dy, dx) L_i(y + dy, x + dx) + bias), L_i = 0 outside the image
//     D_i     = 2 (L_i - L0_i) - 2 (L_{i-1} + R_{i-1} - L_i) [i > 0] + 2 (L_i + R_i - L_{i+1}) [i < last]
//     L_i    <- L_i - alpha_i D_i
//
// initial    L0, block 1; channel z is frame i
// frames     L, block 1; channel z + skip is frame i, its neighbours lie beside it
// residuals  R, block 1; channel z + skip lies between frames i and i + 1
// updated    block 1; channel z is frame i
// Precondition: width <= 64 x groups.x, height = groups.y, one frame a groups.z.
// Tile: one pixel of one frame an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Initial { float initial[]; };
layout(std430, binding = 1) readonly buffer Frames { float frames[]; };
layout(std430, binding = 2) readonly buffer Residuals { float residuals[]; };
layout(std430, binding = 3) writeonly buffer Updated { float updated[]; };

layout(push_constant) uniform Push {
    TensorLayout initial_layout;
    TensorLayout frames_layout;
    TensorLayout residuals_layout;
    TensorLayout updated_layout;
    uint width;
    uint height;
    uint first;
    uint last;
    uint skip;
    float alpha[10]; // 3x3 weights by rows, bias
};

uint place(TensorLayout at, uint c, uint y, uint x) {
    return at.origin + c * at.plane + y * at.row + x; // block 1
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const uint z = gl_WorkGroupID.z;
    if (x >= width) {
        return;
    }
    const uint i = first + z;
    const uint c = z + skip;
    const float value = frames[place(frames_layout, c, y, x)];

    float sum = alpha[9];
    [[unroll]] for (uint dy = 0; dy < 3; ++dy) {
        [[unroll]] for (uint dx = 0; dx < 3; ++dx) {
            // Row y + dy - 1 and column x + dx - 1; those outside are read inside and count as 0.
            const uint v = clamp(y + dy, 1, height) - 1;
            const uint u = clamp(x + dx, 1, width) - 1;
            const bool inside = v + 1 == y + dy && u + 1 == x + dx;
            sum += inside ? alpha[3 * dy + dx] * frames[place(frames_layout, c, v, u)] : 0.0;
        }
    }

    float direction = 2 * (value - initial[place(initial_layout, z, y, x)]);
    if (i > 0) {
        direction -= 2 * (frames[place(frames_layout, c - 1, y, x)] +
                          residuals[place(residuals_layout, c - 1, y, x)] - value);
    }
    if (i < last) {
        direction += 2 * (value + residuals[place(residuals_layout, c, y, x)] -
                          frames[place(frames_layout, c + 1, y, x)]);
    }
    updated[place(updated_layout, z, y, x)] = value - 0.1 * max(sum, 0.0) * direction;
}
