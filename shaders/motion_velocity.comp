#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"
#include "fusion_constants.glsl"

// The velocity field at the anchors from the displacements d over the gaps between them:
//     velocity(a) = 4 (mean of d(a - 1) and d(a), one of them at the ends), pixels a unit of time
//     channels(2 a + i) = velocity(a)(i) / 20, for the trunk
//
// moved       [8][rows][columns] vec2: d; origin in vec2
// channels    18 channels, any layout
// Bindings: 0 moved, 1 channels.
// Precondition: columns <= 64 x groups.x, rows = groups.y, 9 = groups.z.
// Tile: one cell of one anchor an invocation.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Moved { vec2 moved[]; };
layout(std430, binding = 1) writeonly buffer Channels { float channels[]; };

layout(push_constant) uniform Push {
    TensorLayout channels_layout;
    uint moved_origin;
    uint columns;
    uint rows;
};

const float SCALE = 0.05;

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const uint anchor = gl_WorkGroupID.z;
    if (x >= columns) {
        return;
    }
    const uint plane = rows * columns;
    const uint cell = y * columns + x;
    const vec2 before = moved[moved_origin + (max(anchor, 1) - 1) * plane + cell];
    const vec2 after = moved[moved_origin + min(anchor, GAPS - 1) * plane + cell];
    const vec2 mean = (0.5 / GAP) * (before + after);
    channels[element(channels_layout, 2 * anchor, y, x)] = SCALE * mean.x;
    channels[element(channels_layout, 2 * anchor + 1, y, x)] = SCALE * mean.y;
}
