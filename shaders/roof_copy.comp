#version 450
// to[i] = from[i]: the bytes a second that a kernel can move (runtime/roof.cpp).
//
// from, to  [4 x 64 x groups.x x groups.y] floats. Bindings: 0 from, 1 to.
// Workgroup: 64 neighbouring vectors of 4.
layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) readonly buffer From { vec4 from[]; };
layout(set = 0, binding = 1, std430) writeonly buffer To { vec4 to[]; };

void main() {
    const uint group = gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    const uint i = group * 64u + gl_LocalInvocationID.x;
    to[i] = from[i];
}
