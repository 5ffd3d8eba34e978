#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Events by time window, averaged over BIN x BIN pixels. With N+(t) and N-(t), the pixel's positive
// and negative events up to and including t, and window k from s to e, for either sign:
//     counts(k)           = N+(e) - N+(s)
//     counts(2 WINDOWS + k) = (N+(s) + N+(e)) / 2
// and those of N- WINDOWS channels further.
//
// A pixel with more than BUSY events counts as one without: it is faulty rather than telling, and
// lavapipe ends a shader's loops after 65535 iterations in all.
//
// offsets     [sensor pixels + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// event_times [events] in [-1, 1]
// marks       [events]: polarity << 31 | ordinal
// counts      [4 WINDOWS][height][width]
// Bindings: as listed.
// Precondition: sensor >= BIN (width, height); width <= 64 x groups.x, height = groups.y;
// BUSY x BIN x BIN < 2^16.
// Tile: one binned pixel an invocation, 64 x 1 a workgroup. Each event is compared with every window's
// ends, which stay in registers: less work than to search for its window where lanes go separate
// ways. The low half of a sum counts positive events, the high half negative ones.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BIN = 1;
layout(constant_id = 1) const uint BUSY = 4096;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) writeonly buffer Counts { float counts[]; };

layout(push_constant) uniform Push {
    uint counts_origin;
    uint width;  // binned
    uint height; // binned
    uint sensor_width;
};

#include "edi_sampling.glsl"

float normalised(uint time) {
    return float(time) / 256.0 - 1.0;
}

vec2 by_sign(uint sum) {
    return vec2(sum & 0xffffu, sum >> 16);
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    uint starts[WINDOWS]; // events up to a window's start, over the bin's pixels
    uint ends[WINDOWS];
    [[unroll]] for (uint k = 0; k < WINDOWS; ++k) {
        starts[k] = ends[k] = 0;
    }
    for (uint part = 0; part < BIN * BIN; ++part) {
        const uint pixel = (y * BIN + part / BIN) * sensor_width + x * BIN + part % BIN;
        const uint begin = offsets[pixel];
        const uint stop = offsets[pixel + 1];
        const uint end = stop - begin > BUSY ? begin : stop;
        for (uint event = begin; event < end; ++event) {
            const float time = event_times[event];
            const uint one = (marks[event] >> 31) != 0 ? 1u : 0x10000u;
            [[unroll]] for (uint k = 0; k < WINDOWS; ++k) {
                const uint start = WINDOW_FIRST + k * WINDOW_SPACING;
                starts[k] += time <= normalised(start) ? one : 0;
                ends[k] += time <= normalised(start + WINDOW_LENGTH) ? one : 0;
            }
        }
    }

    const uint plane = width * height;
    const float share = 1.0 / float(BIN * BIN);
    [[unroll]] for (uint k = 0; k < WINDOWS; ++k) {
        const uint at = counts_origin + k * plane + y * width + x;
        const vec2 start = by_sign(starts[k]);
        const vec2 end = by_sign(ends[k]);
        const vec2 change = share * (end - start);
        const vec2 middle = 0.5 * share * (end + start);
        counts[at] = change.x;
        counts[at + WINDOWS * plane] = change.y;
        counts[at + 2 * WINDOWS * plane] = middle.x;
        counts[at + 3 * WINDOWS * plane] = middle.y;
    }
}
