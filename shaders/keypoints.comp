#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// Keypoint selection (figure 2a): each pivot moves to the nearest event of its pixel in its own cell,
//     a_e    = scale (tick_e - origin) + bias                     an event's place, exact in 32 bits
//     cell_e = floor(a_e / (2 span))
//     t_k    = time of the first e that minimises |a_e - (2 k + 1) span| over cell_e = k, else pivot k
//
// offsets    [height * width + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// times      [events]: the values keypoints take, normalised
// ticks      [events]: microseconds, ascending within a pixel
// rule       scale, origin, bias, span (KeypointRule in layers/keypoints.hpp)
// keypoints  any layout, channels first ... first + n - 1, and zeros up to `filled`
// Precondition: 2 n span < 2^32 and cell_e < n; width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer Times { float times[]; };
layout(std430, binding = 2) readonly buffer Ticks { uint ticks[]; };
layout(std430, binding = 3) readonly buffer Rule {
    uint scale;
    uint origin;
    uint bias;
    uint span;
};
layout(std430, binding = 4) writeonly buffer Keypoints { float keypoints[]; };

layout(push_constant) uniform Push {
    TensorLayout keypoints_layout;
    uint width;
    uint height;
    uint first;
    uint n;
    uint filled;
    float pivots[20];
};

const uint NONE = 0xFFFFFFFFu;

// a_e, or NONE (beyond every cell) behind the last event.
uint place_of(uint event, uint end) {
    uint place = NONE;
    if (event < end) {
        place = scale * (ticks[event] - origin) + bias;
    }
    return place;
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const uint pixel = y * width + x;
    uint event = offsets[pixel];
    const uint end = offsets[pixel + 1];
    uint place = place_of(event, end);
    for (uint k = 0; k < n; ++k) {
        const uint pivot = (2 * k + 1) * span;
        const uint cell_end = pivot + span;
        float keypoint = pivots[k];
        uint nearest = NONE;
        // Earlier cells have taken all events before this one's start.
        while (place < cell_end) {
            const uint distance = max(place, pivot) - min(place, pivot);
            if (distance < nearest) {
                nearest = distance;
                keypoint = times[event];
            }
            ++event;
            place = place_of(event, end);
        }
        keypoints[element(keypoints_layout, first + k, y, x)] = keypoint;
    }
    for (uint c = first + n; c < filled; ++c) {
        keypoints[element(keypoints_layout, c, y, x)] = 0;
    }
}
