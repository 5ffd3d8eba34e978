#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "tensor.glsl"
#include "fusion_constants.glsl"

// The event-driven prior L(t) of an exposure (prior_steps.glsl) as the inputs of the fusion network's
// trunk and of its local motion, in one walk over the events of each pixel. t_k = -1 + 2 k / WINDOWS:
//     base        = b = ln(B + e) - ln(mean of exp(E)); the mean takes each ramp as a step in its middle
//     anchors(a)  = L(t_{4 a}),  a = 0 ... 8
//     context(0)  = B
//     context(1 + a) = log2(1 + n) / 4, n = min(events from anchor a up to, not including, a + 1, 255);
//                   the last interval includes its end
//     logarithms(k) = mean over 2 x 2 pixels of ln(max(L(t_k), 0) + 0.05), k = 0 ... WINDOWS; the last
//                   column and row count twice where the size is odd
// Pixels with more than BUSY events are taken as pixels without events.
//
// offsets     [pixels + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// event_times [events] ascending within a pixel, in [-1, 1]
// marks       [events]: polarity << 31 | ordinal
// thresholds  [2]: c+, c-
// blurry      1 channel, 0 ... 1 and finite, for what is made of it says where other kernels read;
//             anchors, context 9 channels, base 1; logarithms WINDOWS + 1 channels at half
//             the size rounded up; all any layout
// Bindings: 0 offsets, 1 event_times, 2 marks, 3 blurry, 4 thresholds, 5 anchors, 6 context, 7 base,
//   8 logarithms.
// Preconditions: (width + 1) / 2 <= 64 x groups.x, (height + 1) / 2 = groups.y; lavapipe ends a
//   shader's loops after 65535 iterations in all, and 16 lanes wait for each other at each of the
//   frames, so 4 (1 + 16) BUSY must be below that.
// Tile: 2 x 2 pixels an invocation, 64 x 1 invocations a workgroup.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BUSY = 768;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 4) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 5) writeonly buffer Anchors { float anchors[]; };
layout(std430, binding = 6) writeonly buffer Context { float context[]; };
layout(std430, binding = 7) writeonly buffer Base { float bases[]; };
layout(std430, binding = 8) writeonly buffer Logarithms { float logarithms[]; };

layout(push_constant) uniform Push {
    TensorLayout blurry_layout;
    TensorLayout anchors_layout;
    TensorLayout context_layout;
    TensorLayout base_layout;
    TensorLayout logarithms_layout;
    uint width;
    uint height;
};

#include "edi_steps.glsl"
#include "prior_steps.glsl"

const float DARK = 0.05; // of the logarithms; larger than e, so that the dark is less noisy
const uint MOST_COUNTED = 255;

// A pixel between two of its events.
struct Walk {
    uint event; // the next
    uint end;
    ivec2 state;
    float before; // time of the one before, or -1
    float next;   // time of the next, or AFTER
    uint mark;    // of the next
    float base;
    uint count; // events since the last anchor
};

void look_ahead(inout Walk walk) {
    walk.next = AFTER; // so late that there is nothing of its step yet
    if (walk.event < walk.end) {
        walk.next = event_times[walk.event];
        walk.mark = marks[walk.event];
    }
}

Walk begin_walk(uint y, uint x) {
    const uint pixel = y * width + x;
    const uint begin = offsets[pixel];
    uint end = offsets[pixel + 1];
    if (end - begin > BUSY) {
        end = begin;
    }
    Integral integral = Integral(ivec2(0), 0, true);
    ivec2 state = ivec2(0);
    float last = -1;
    float middle = -1;
    for (uint event = begin; event < end; ++event) {
        const float time = event_times[event];
        const float here = time - 0.5 * min(time - last, RAMP);
        add_piece(integral, state, here - middle);
        middle = here;
        last = time;
        state = next_state(state, marks[event]);
    }
    add_piece(integral, state, 1 - middle);

    const float image = blurry[element(blurry_layout, 0, y, x)];
    Walk walk;
    walk.event = begin;
    walk.end = end;
    walk.state = ivec2(0);
    walk.before = -1;
    walk.base = log(image + SMALL) - log(0.5 * integral.sum) - exponent(integral.peak);
    walk.count = 0;
    walk.mark = 0;
    look_ahead(walk);
    bases[element(base_layout, 0, y, x)] = walk.base;
    context[element(context_layout, 0, y, x)] = image;
    return walk;
}

// Goes on to the events after `time`; returns how many of them were at that very time.
uint go_on(inout Walk walk, float time) {
    uint now = 0;
    while (walk.next <= time) {
        if (walk.next < time) {
            ++walk.count;
        } else {
            ++now;
        }
        walk.state = next_state(walk.state, walk.mark);
        walk.before = walk.next;
        ++walk.event;
        look_ahead(walk);
    }
    return now;
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (2 * x >= width) {
        return;
    }
    const uvec2 columns = uvec2(2 * x, min(2 * x + 1, width - 1));
    const uvec2 rows = uvec2(2 * y, min(2 * y + 1, height - 1));
    Walk walks[4];
    [[unroll]] for (uint i = 0; i < 4; ++i) {
        walks[i] = begin_walk(rows[i / 2], columns[i % 2]);
    }
    for (uint k = 0; k <= WINDOWS; ++k) {
        const float time = float(k) * (2.0 / float(WINDOWS)) - 1;
        const uint anchor = k / WINDOWS_AN_ANCHOR;
        const bool at_anchor = k == anchor * WINDOWS_AN_ANCHOR;
        float sum = 0;
        [[unroll]] for (uint i = 0; i < 4; ++i) {
            const uint now = go_on(walks[i], time);
            const float level = exponent(walks[i].state) +
                                step_of(walks[i].mark) *
                                    ramp(time, walks[i].before, walks[i].next);
            const float value = prior_value(walks[i].base + level);
            sum += log(max(value, 0) + DARK);
            if (at_anchor) {
                anchors[element(anchors_layout, anchor, rows[i / 2], columns[i % 2])] = value;
                if (k > 0) {
                    const uint all = walks[i].count + (k == WINDOWS ? now : 0);
                    context[element(context_layout, anchor, rows[i / 2], columns[i % 2])] =
                        0.25 * log2(1 + float(min(all, MOST_COUNTED)));
                    walks[i].count = 0;
                }
            }
            walks[i].count += now;
        }
        logarithms[element(logarithms_layout, k, y, x)] = 0.25 * sum;
    }
}
