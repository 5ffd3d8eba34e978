#version 450
#extension GL_GOOGLE_include_directive : require

// Where what is at a cell's centre g at a wanted time t is at the anchor times, as displacement in
// pixels: the displacements d over the gaps between anchors followed from gap to gap. d(i) is known by
// where things are half-way through gap i, so it is read at a first guess of that. In the gap around t,
// of which the share s has passed at t,
//     m = d(i, g + (1/2 - s) d(i, g)),   away = -s m at the anchor before, (1 - s) m at the one after
// and in each gap on from there, in the direction f = +-1,
//     p' = p + f d(i, p + f d(i, p) / 2),   away = p' - g
// d between cell centres is bilinear, beyond the outer ones their value. A cell is 8 x 8 pixels.
//
// moved      [8][height][width] vec2: x and y, pixels; finite, for it says what is read
// instant    layers/instant.hpp: time, place = 4 (t + 1), the anchor below
// away       [9][height][width] vec2
// Bindings: 0 moved, 1 instant, 2 away. Origins in vec2.
// Precondition: width <= 64 x groups.x, height = groups.y; groups.z = 2, backward and forward in time.
// Tile: one cell in one direction an invocation.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Moved { vec2 moved[]; };
layout(std430, binding = 1) readonly buffer Instant { uint instant[]; };
layout(std430, binding = 2) writeonly buffer Away { vec2 away[]; };

layout(push_constant) uniform Push {
    uint moved_origin;
    uint instant_origin;
    uint away_origin;
    uint width;
    uint height;
};

#include "bilinear.glsl"
#include "fusion_constants.glsl"

// d(gap) at a position in cells from the centre of the first one.
vec2 moved_at(uint gap, vec2 position) {
    const Neighbours n = neighbours(position, vec2(width - 1, height - 1));
    const uint plane = moved_origin + gap * (width * height);
    const uint row = plane + n.at.y * width;
    const uint below = plane + n.next.y * width;
    const vec2 upper = mix(moved[row + n.at.x], moved[row + n.next.x], n.share.x);
    const vec2 lower = mix(moved[below + n.at.x], moved[below + n.next.x], n.share.x);
    return mix(upper, lower, n.share.y);
}

// d(gap) of what is at `position` when `ahead` of the gap is still to come until its middle.
vec2 gap_moved(uint gap, vec2 position, float ahead) {
    return moved_at(gap, position + ahead * moved_at(gap, position) / float(CELL));
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const float place = uintBitsToFloat(instant[instant_origin + INSTANT_PLACE]);
    const uint below = instant[instant_origin + INSTANT_BELOW];
    const float share = place - float(below);
    const bool forward = gl_WorkGroupID.z == 1;
    const float direction = forward ? 1.0 : -1.0;
    const uint plane = width * height;
    const uint cell = away_origin + y * width + x;
    const vec2 centre = vec2(x, y);

    vec2 gone = gap_moved(below, centre, 0.5 - share) * (forward ? 1 - share : -share); // pixels
    away[cell + (forward ? below + 1 : below) * plane] = gone;
    const uint rest = forward ? GAPS - 1 - below : below;
    for (uint i = 1; i <= rest; ++i) {
        const uint gap = forward ? below + i : below - i;
        gone += direction * gap_moved(gap, centre + gone / float(CELL), 0.5 * direction);
        away[cell + (forward ? gap + 1 : gap) * plane] = gone;
    }
}
