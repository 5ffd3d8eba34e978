#version 450
#extension GL_GOOGLE_include_directive : require

// Displacements d over the gaps between neighbouring anchors, in pixels, from smoothed moments q and
// their least-squares solution s (motion_steps.glsl):
//     FIRST = 1: q at the anchors, a window's displacement; v(a) = 16 s(q(a), 2e-6) cut at +-160
//                pixels a unit of time, d(i) = (v(i) + v(i + 1)) / 8
//     FIRST = 0: q at the gaps, what remains; d(i) += s(q(i), 2e-5) cut at +-2
//
// moments     [5][FIRST = 1: 9, else 8][rows][columns]
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

const float WINDOWS_A_UNIT = 16; // of time
const float RIDGE = 2e-6;        // added to the mean squared gradients
const float FASTEST = 160;
const float ROUND_RIDGE = 2e-5;
const float ROUND_LIMIT = 2;

Moments moments_at(uint at, uint step) {
    return Moments(vec3(planes[at], planes[at + step], planes[at + 2 * step]),
                   vec2(planes[at + 3 * step], planes[at + 4 * step]));
}

vec2 velocity(uint at, uint step) {
    return clamp(WINDOWS_A_UNIT * solve(moments_at(at, step), RIDGE), -FASTEST, FASTEST);
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
    const uint at = moments_origin + cell;
    if (FIRST != 0) {
        const uint step = (gl_NumWorkGroups.z + 1) * plane;
        moved[moved_origin + cell] =
            0.5 * GAP * (velocity(at, step) + velocity(at + plane, step));
    } else {
        const vec2 rest = solve(moments_at(at, gl_NumWorkGroups.z * plane), ROUND_RIDGE);
        moved[moved_origin + cell] += clamp(rest, -ROUND_LIMIT, ROUND_LIMIT);
    }
}
