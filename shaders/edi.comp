#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// Event-based double integral. With the steps E(t) = c+ N+(t) - c- N-(t), where N+-(t) counts the
// pixel's events up to and including t, and e = 0.01:
//     L(t) + e = (B + e) exp(E(t)) / mean over [-1, 1] of exp(E)
// The mean is the sum over the pieces between events. All exponents are relative to the largest E of
// a piece longer than zero, counted in whole events, so that any number of events stays finite; the
// final one is cut at 80.
//
// Pixels with more than BUSY events are left to edi_busy.comp: lavapipe ends a shader's loops after
// 65535 iterations in all, and one long loop would hold up a GPU.
//
// offsets     [sensor pixels + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// event_times [events] ascending within a pixel, in [-1, 1]
// marks       [events]: polarity << 31 | ordinal
// blurry      any layout, channel blurry_channel
// schedule    [2][count]: ascending frame times as floats, then the frame that each belongs to
// thresholds  [2]: c+, c-
// frames      any layout; frames first, ..., first + limit - 1 are written as channels 0, 1, ...
// Precondition: width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 a workgroup.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BUSY = 4096;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 4) readonly buffer Schedule { uint schedule[]; };
layout(std430, binding = 5) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 6) writeonly buffer Frames { float frames[]; };

layout(push_constant) uniform Push {
    TensorLayout blurry_layout;
    TensorLayout frames_layout;
    uint width;
    uint blurry_channel;
    uint count;
    uint first;
    uint limit;
};

#include "edi_steps.glsl"

const float AFTER = 2; // later than any frame

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const uint pixel = y * width + x;
    const uint begin = offsets[pixel];
    const uint end = offsets[pixel + 1];
    if (end - begin > BUSY) {
        return;
    }

    Integral integral = Integral(ivec2(0), 0, true);
    ivec2 state = ivec2(0);
    float last = -1;
    for (uint event = begin; event < end; ++event) {
        const float time = event_times[event];
        add_piece(integral, state, time - last);
        last = time;
        state = next_state(state, marks[event]);
    }
    add_piece(integral, state, 1 - last);

    const float base =
        log(blurry[element(blurry_layout, blurry_channel, y, x)] + SMALL) - log(0.5 * integral.sum);
    state = ivec2(0);
    uint event = begin;
    float next = event < end ? event_times[event] : AFTER;
    for (uint k = 0; k < count; ++k) {
        const float time = uintBitsToFloat(schedule[k]);
        while (next <= time) {
            state = next_state(state, marks[event]);
            ++event;
            next = event < end ? event_times[event] : AFTER;
        }
        const uint frame = schedule[count + k];
        if (frame >= first && frame - first < limit) {
            frames[element(frames_layout, frame - first, y, x)] =
                exp(min(base + exponent(state - integral.peak), LARGEST_EXPONENT)) - SMALL;
        }
    }
}
