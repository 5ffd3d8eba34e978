#version 450
#extension GL_GOOGLE_include_directive : require

// Where what is at a cell's centre g at a wanted time t is at the anchor times, as displacement in
// pixels: the velocity field v followed from t to the nearest anchor on either side, and from anchor to
// anchor on to the first and the last one, by Heun steps. From p_0 = g, s_0 = v(t) at the cell (linear
// between its anchors), over the signed time h_i to anchor a_i:
//     p_{i+1} = p_i + h_i / 2 (s_i + v(a_i, p_i + h_i s_i)),   s_{i+1} = v(a_i, p_{i+1})
//     away(a_i) = p_{i+1} - g
// v between cell centres is bilinear, beyond the outer ones their value. A cell is 8 x 8 pixels.
//
// velocity   [9][height][width] vec2: x and y, pixels a unit of time; finite, for it says what is read
// instant    layers/instant.hpp: time, place = 4 (t + 1), the anchor below
// away       [9][height][width] vec2
// Bindings: 0 velocity, 1 instant, 2 away. Origins in vec2.
// Precondition: width <= 64 x groups.x, height = groups.y; groups.z = 2, backward and forward in time.
// Tile: one cell in one direction an invocation.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Velocity { vec2 velocity[]; };
layout(std430, binding = 1) readonly buffer Instant { uint instant[]; };
layout(std430, binding = 2) writeonly buffer Away { vec2 away[]; };

layout(push_constant) uniform Push {
    uint velocity_origin;
    uint instant_origin;
    uint away_origin;
    uint width;
    uint height;
};

#include "bilinear.glsl"
#include "fusion_constants.glsl"

// v(anchor) at a position in cells from the centre of the first one.
vec2 velocity_at(int anchor, vec2 position) {
    const Neighbours n = neighbours(position, vec2(width - 1, height - 1));
    const uint plane = velocity_origin + uint(anchor) * (width * height);
    const uint row = plane + n.at.y * width;
    const uint below = plane + n.next.y * width;
    const vec2 upper = mix(velocity[row + n.at.x], velocity[row + n.next.x], n.share.x);
    const vec2 lower = mix(velocity[below + n.at.x], velocity[below + n.next.x], n.share.x);
    return mix(upper, lower, n.share.y);
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const float place = uintBitsToFloat(instant[instant_origin + INSTANT_PLACE]);
    const int below = int(instant[instant_origin + INSTANT_BELOW]);
    const bool forward = gl_WorkGroupID.z == 1;
    const int direction = forward ? 1 : -1;
    const uint cell = y * width + x;
    const uint plane = width * height;
    const vec2 centre = vec2(x, y);

    const uint now = velocity_origin + uint(below) * plane + cell;
    vec2 speed = mix(velocity[now], velocity[now + plane], place - float(below));
    vec2 moved = vec2(0); // pixels
    int anchor = forward ? below + 1 : below;
    float span = (float(anchor) - place) * GAP;
    for (; anchor >= 0 && anchor < int(ANCHORS); anchor += direction) {
        const vec2 ahead = velocity_at(anchor, centre + (moved + span * speed) / float(CELL));
        moved += 0.5 * span * (speed + ahead);
        away[away_origin + uint(anchor) * plane + cell] = moved;
        speed = velocity_at(anchor, centre + moved / float(CELL));
        span = float(direction) * GAP;
    }
}
