#version 450
#extension GL_GOOGLE_include_directive : require

// Displacements d over the gaps between neighbouring anchors, in pixels, from smoothed moments q and
// their least-squares solution s (motion_steps.glsl):
//     FIRST = 1: q of the displacements in a gap's 4 windows, d(i) = 4 s(q(i), 2e-6) cut at +-40
//     FIRST = 0: q of what remains over the gap, d(i) += s(q(i), 1e-3) cut at +-2
//
// moments     [5][8][rows][columns]
// moved       [8][rows][columns] vec2: d, origin in vec2
// Bindings: 0 moments, 1 moved.
// Precondition: columns <= 64 x groups.x, rows = groups.y, 8 = groups.z.
// Tile: one cell of one gap an invocation.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint FIRST = 1;

layout(std430, binding = 0) readonly buffer MomentPlanes { float planes[]; };
layout(std430, binding = 1) buffer Moved { vec2 moved[]; };

layout(push_constant) uniform Push {
    uint moments_origin;
    uint moved_origin;
    uint columns;
    uint rows;
};

#include "fusion_constants.glsl"
#include "motion_steps.glsl"

const float RIDGE = 2e-6; // added to the mean squared gradients
const float FASTEST = 40;
// Large: between two anchors what does not move, the prior's error of the pixels that lack events, weighs
// as much as what does.
const float ROUND_RIDGE = 1e-3;
const float ROUND_LIMIT = 2;

Moments moments_at(uint at, uint step) {
    return Moments(vec3(planes[at], planes[at + step], planes[at + 2 * step]),
                   vec2(planes[at + 3 * step], planes[at + 4 * step]));
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const uint gap = gl_WorkGroupID.z;
    if (x >= columns) {
        return;
    }
    const uint plane = rows * columns;
    const uint cell = gap * plane + y * columns + x;
    const Moments moments = moments_at(moments_origin + cell, GAPS * plane);
    if (FIRST != 0) {
        moved[moved_origin + cell] =
            clamp(float(WINDOWS_A_GAP) * solve(moments, RIDGE), -FASTEST, FASTEST);
    } else {
        moved[moved_origin + cell] +=
            clamp(solve(moments, ROUND_RIDGE), -ROUND_LIMIT, ROUND_LIMIT);
    }
}
