#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// Event histogram E (section 4.2; Voxelize in algorithm 1):
//     counts(2 i, y, x)     = number of positive events of pixel (y, x) in interval i
//     counts(2 i + 1, y, x) = number of the others
//
// offsets    [height * width + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// marks      [events]: polarity << 31 | ordinal, ordinals ascend within a pixel
// intervals  [intervals]: ordinals begin <= o < end; `begin` never goes back, ranges may overlap
// counts     any layout, `channels` channels of which those from 2 count on become 0
// Precondition: width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 pixels a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 2) readonly buffer Intervals { uvec2 intervals[]; };
layout(std430, binding = 3) writeonly buffer Counts { float counts[]; };

layout(push_constant) uniform Push {
    TensorLayout counts_layout;
    uint width;
    uint height;
    uint first;    // interval of channel 0
    uint count;    // intervals to count
    uint channels; // of `counts`, the filled-up last block included
};

uint ordinal(uint mark) { return mark & 0x7FFFFFFFu; }

// The mark of an event, or one behind every interval after the last event.
uint mark_of(uint event, uint end) {
    uint mark = 0xFFFFFFFFu;
    if (event < end) {
        mark = marks[event];
    }
    return mark;
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const uint pixel = y * width + x;
    uint cursor = offsets[pixel];
    const uint end = offsets[pixel + 1];
    uint mark = mark_of(cursor, end);
    for (uint i = 0; i < count; ++i) {
        const uvec2 interval = intervals[first + i];
        while (ordinal(mark) < interval.x) {
            ++cursor;
            mark = mark_of(cursor, end);
        }
        uint total = 0;
        uint positive = 0;
        // The cursor stays: the next interval may begin inside this one.
        for (uint counted = mark; ordinal(counted) < interval.y;
             counted = mark_of(cursor + total, end)) {
            ++total;
            positive += counted >> 31;
        }
        counts[element(counts_layout, 2 * i, y, x)] = float(positive);
        counts[element(counts_layout, 2 * i + 1, y, x)] = float(total - positive);
    }
    for (uint c = 2 * count; c < channels; ++c) {
        counts[element(counts_layout, c, y, x)] = 0;
    }
}
