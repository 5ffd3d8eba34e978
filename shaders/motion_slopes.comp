#version 450
#extension GL_GOOGLE_include_directive : require

// The smoothed logarithms X at the fusion network's anchors with their gradients:
//     slopes(a) = X_{4 a}, d X / dx, d X / dy, 0
// Derivatives a full pixel, half of a sample of X, as central differences, border samples repeated.
//
// frames      [33][height][width]: X
// slopes      [9][height][width] vec4, origin in vec4
// Bindings: 0 frames, 1 slopes.
// Precondition: width <= 64 x groups.x, height = groups.y, 9 = groups.z.
// Tile: one sample an invocation, 64 x 1 x 1 a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Frames { float frames[]; };
layout(std430, binding = 1) writeonly buffer Slopes { vec4 slopes[]; };

layout(push_constant) uniform Push {
    uint frames_origin;
    uint slopes_origin;
    uint width;
    uint height;
};

#include "fusion_constants.glsl"

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const uint anchor = gl_WorkGroupID.z;
    if (x >= width) {
        return;
    }
    const uint plane = width * height;
    const uint at = y * width + x;
    const uint here = frames_origin + WINDOWS_A_GAP * anchor * plane + at;
    const vec2 slope = vec2(frames[here + (x + 1 < width ? 1 : 0)] - frames[here - min(x, 1)],
                            frames[here + (y + 1 < height ? width : 0)] -
                                frames[here - (y > 0 ? width : 0)]);
    slopes[slopes_origin + anchor * plane + at] = vec4(frames[here], 0.25 * slope, 0);
}
