#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// Event histogram E (section 4.2; Voxelize in algorithm 1):
//     counts(2 i, y, x)     = number of positive events of pixel (y, x) in interval i
//     counts(2 i + 1, y, x) = number of the others
//
// offsets    [height * width + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// marks      [events]: polarity << 31 | ordinal, ordinals ascend within a pixel
// positives  [events + 1]: positive events before each
// intervals  [intervals]: ordinals begin <= o < end; `begin` never goes back, ranges may overlap
// counts     any layout, `channels` channels of which those from 2 count on become 0
// Precondition: width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 2) readonly buffer Positives { uint positives[]; };
layout(std430, binding = 3) readonly buffer Intervals { uvec2 intervals[]; };
layout(std430, binding = 4) writeonly buffer Counts { float counts[]; };

layout(push_constant) uniform Push {
    TensorLayout counts_layout;
    uint width;
    uint height;
    uint first;    // interval of channel 0
    uint count;    // intervals to count
    uint channels; // of `counts`, the filled-up last block included
};

// The first of the events begin, ..., end - 1 whose ordinal is not below `bound`, or end. By bisection:
// lavapipe ends a shader's loops after 65535 iterations, and a million events may share a pixel.
uint first_from(uint begin, uint end, uint bound) {
    while (begin < end) {
        const uint middle = begin + (end - begin) / 2;
        if ((marks[middle] & 0x7FFFFFFFu) < bound) {
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
    uint begin = offsets[pixel];
    const uint end = offsets[pixel + 1];
    uint after = begin;
    uint reached = 0; // ordinal where the interval before ended: mostly where the next one begins
    for (uint i = 0; i < count; ++i) {
        const uvec2 interval = intervals[first + i];
        begin = interval.x == reached ? after : first_from(begin, end, interval.x);
        after = first_from(begin, end, interval.y);
        reached = interval.y;
        uint positive = 0;
        if (after > begin) {
            positive = positives[after] - positives[begin];
        }
        counts[element(counts_layout, 2 * i, y, x)] = float(positive);
        counts[element(counts_layout, 2 * i + 1, y, x)] = float(after - begin - positive);
    }
    for (uint c = 2 * count; c < channels; ++c) {
        counts[element(counts_layout, c, y, x)] = 0;
    }
}
