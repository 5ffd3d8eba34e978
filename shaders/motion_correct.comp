#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// The velocity field with what the fusion network's trunk found that it lacks:
//     corrected(a)(i) = velocity(a)(i) + 20 correction(2 a + i),  pixels a unit of time
// 20 undoes the scale of what the trunk sees (motion_velocity.comp).
//
// velocity, corrected  [9][rows][columns] vec2; origins in vec2
// correction           18 channels, any layout
// Bindings: 0 velocity, 1 correction, 2 corrected.
// Precondition: columns <= 64 x groups.x, rows = groups.y, 9 = groups.z.
// Tile: one cell of one anchor an invocation.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Velocity { vec2 velocity[]; };
layout(std430, binding = 1) readonly buffer Correction { float correction[]; };
layout(std430, binding = 2) writeonly buffer Corrected { vec2 corrected[]; };

layout(push_constant) uniform Push {
    TensorLayout correction_layout;
    uint velocity_origin;
    uint corrected_origin;
    uint columns;
    uint rows;
};

const float SCALE = 20.0;

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const uint anchor = gl_WorkGroupID.z;
    if (x >= columns) {
        return;
    }
    const uint cell = (anchor * rows + y) * columns + x;
    const vec2 lacking = vec2(correction[element(correction_layout, 2 * anchor, y, x)],
                              correction[element(correction_layout, 2 * anchor + 1, y, x)]);
    corrected[corrected_origin + cell] = velocity[velocity_origin + cell] + SCALE * lacking;
}
