#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "tensor.glsl"

// Input of the residual network of interval i (algorithm 1, lines 5 and 8), by channel:
//     L_i, L_{i+1}, dx L_i, dy L_i, dx L_{i+1}, dy L_{i+1}, positive events, other events, R_{i-1} (i > 0)
//     dx L(y, x) = L(y, x - 1) - L(y, x), 0 for x = 0;   dy L(y, x) = L(y - 1, x) - L(y, x), 0 for y = 0
//
// frames     any layout, channels `frame` and frame + 1
// counts     any layout, channels `count` and count + 1
// residuals  any layout, channel `residual`; not read when first = 1
// result     any layout, 8 (first = 1) or 9 channels; what fills up the last block is left alone
// Precondition: width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Frames { float frames[]; };
layout(std430, binding = 1) readonly buffer Counts { float counts[]; };
layout(std430, binding = 2) readonly buffer Residuals { float residuals[]; };
layout(std430, binding = 3) writeonly buffer Result { float result[]; };

layout(push_constant) uniform Push {
    TensorLayout frames_layout;
    TensorLayout counts_layout;
    TensorLayout residuals_layout;
    TensorLayout result_layout;
    uint width;
    uint height;
    uint frame;
    uint count;
    uint residual;
    uint first;
};

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const uint at[2] = {element(frames_layout, frame, y, x),
                        element(frames_layout, frame + 1, y, x)};
    const float value[2] = {frames[at[0]], frames[at[1]]};
    // 0 at the border, where the difference is one of the pixel and itself.
    const uint left = min(x, 1) * frames_layout.block;
    const uint above = min(y, 1) * frames_layout.row;

    result[element(result_layout, 0, y, x)] = value[0];
    result[element(result_layout, 1, y, x)] = value[1];
    [[unroll]] for (uint i = 0; i < 2; ++i) {
        result[element(result_layout, 2 + 2 * i, y, x)] = frames[at[i] - left] - value[i];
        result[element(result_layout, 3 + 2 * i, y, x)] = frames[at[i] - above] - value[i];
    }
    result[element(result_layout, 6, y, x)] = counts[element(counts_layout, count, y, x)];
    result[element(result_layout, 7, y, x)] = counts[element(counts_layout, count + 1, y, x)];
    if (first == 0) {
        result[element(result_layout, 8, y, x)] =
            residuals[element(residuals_layout, residual, y, x)];
    }
}
