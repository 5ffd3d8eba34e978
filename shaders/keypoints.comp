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

uint place_of(uint event) { return scale * (ticks[event] - origin) + bias; }

// The first of the events begin, ..., end - 1 whose place is not below `bound`, or end. By bisection, as in
// event_histogram.comp.
uint first_from(uint begin, uint end, uint bound) {
    while (begin < end) {
        const uint middle = begin + (end - begin) / 2;
        if (place_of(middle) < bound) {
            begin = middle + 1;
        } else {
            end = middle;
        }
    }
    return begin;
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const uint pixel = y * width + x;
    uint begin = offsets[pixel]; // of the cell: earlier cells have taken all events before
    const uint end = offsets[pixel + 1];
    for (uint k = 0; k < n; ++k) {
        const uint pivot = (2 * k + 1) * span;
        const uint cell_end = pivot + span;
        const uint at = first_from(begin, end, pivot); // the nearest is this one or the one before
        float keypoint = pivots[k];
        uint nearest = 0xFFFFFFFFu;
        if (at > begin) {
            nearest = pivot - place_of(at - 1);
            keypoint = times[at - 1];
        }
        begin = at;
        if (at < end) {
            const uint place = place_of(at);
            if (place < cell_end && place - pivot < nearest) {
                keypoint = times[at];
            }
            begin = first_from(at, end, cell_end);
        }
        keypoints[element(keypoints_layout, first + k, y, x)] = keypoint;
    }
    for (uint c = first + n; c < filled; ++c) {
        keypoints[element(keypoints_layout, c, y, x)] = 0;
    }
}
