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
//   shader's loops after 65535 iterations in all, so 8 BUSY and some hundred must be below that.
// Tile: 2 x 2 pixels an invocation, 64 x 1 invocations a workgroup.
//
// Where there are branches and loops lavapipe reads push constants and thresholds lane by lane (some 17
// cycles a time), and it runs the body of a loop at least once with no lane active. Hence copies of them all
// at the start, one loop over what events any of the four pixels passes, and stores of anchors outside the
// loop over windows. Vectors of four rather than arrays: those it keeps in memory here, element by element
// and lane by lane. On Mesa 22.3.6 at 240x180 with 100,000 events on one core all that makes 10 ms of 33.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BUSY = 768;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 4) readonly buffer Thresholds { float threshold_pair[]; };
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

float thresholds[2];

#include "edi_steps.glsl"
#include "prior_steps.glsl"

const float DARK = 0.05; // of the logarithms; larger than e, so that the dark is less noisy
const int MOST_COUNTED = 255;

// Four pixels, each between two of its events.
struct Walks {
    uvec4 event; // the next
    uvec4 end;
    uvec4 mark; // of the next
    vec4 next;  // time of the next, or AFTER: so late that there is nothing of its step yet
    vec4 before; // time of the one before, or -1
    ivec4 difference; // of the events so far: positive less negative ones
    ivec4 negatives;
    ivec4 count; // events since the last anchor, before the frame's time
    ivec4 now;   // and at the very time of the frame
    vec4 base;
};

// The level without the events' steps, and the first event.
float begin_walk(uint begin, uint end, float image, out float first, out uint first_mark) {
    Integral integral = Integral(ivec2(0), 0, true);
    ivec2 state = ivec2(0);
    float last = -1;
    float middle = -1;
    first = AFTER;
    first_mark = 0;
    for (uint event = begin; event < end; ++event) {
        const float time = event_times[event];
        const uint mark = marks[event];
        const float here = time - 0.5 * min(time - last, RAMP);
        add_piece(integral, state, here - middle);
        middle = here;
        last = time;
        state = next_state(state, mark);
        first_mark = event == begin ? mark : first_mark;
        first = min(first, time);
    }
    add_piece(integral, state, 1 - middle);
    return log(image + SMALL) - log(0.5 * integral.sum) - exponent(integral.peak);
}

// Goes on to the events after `time`, one at a time of those that any of the four pixels passes.
void go_on(inout Walks walks, float time) {
    walks.now = ivec4(0);
    bool more;
    do {
        const bvec4 waits = lessThanEqual(walks.next, vec4(time));
        more = any(waits);
        const bvec4 moves = bvec4(waits.x, waits.y && !waits.x, waits.z && !waits.x && !waits.y,
                                  waits.w && !waits.x && !waits.y && !waits.z);
        const uint next = 1 + (moves.x   ? walks.event.x
                               : moves.y ? walks.event.y
                               : moves.z ? walks.event.z
                                         : walks.event.w);
        const uint end = moves.x   ? walks.end.x
                         : moves.y ? walks.end.y
                         : moves.z ? walks.end.z
                                   : walks.end.w;
        float next_time = AFTER;
        uint next_mark = 0;
        if (more && next < end) {
            next_time = event_times[next];
            next_mark = marks[next];
        }
        const ivec4 one = ivec4(moves);
        const ivec4 at_once = ivec4(equal(walks.next, vec4(time))) * one;
        const ivec4 positive = one * ivec4(walks.mark >> 31);
        walks.now += at_once;
        walks.count += one - at_once;
        walks.difference += 2 * positive - one;
        walks.negatives += one - positive;
        walks.before = mix(walks.before, walks.next, moves);
        walks.next = mix(walks.next, vec4(next_time), moves);
        walks.mark = mix(walks.mark, uvec4(next_mark), moves);
        walks.event += uvec4(one);
    } while (more);
}

float prior_at(Walks walks, uint i, float time) {
    const float level = exponent(ivec2(walks.difference[i], walks.negatives[i])) +
                        step_of(walks.mark[i]) * ramp(time, walks.before[i], walks.next[i]);
    return prior_value(walks.base[i] + level);
}

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    const TensorLayout to_anchors = anchors_layout;
    const TensorLayout to_context = context_layout;
    const TensorLayout to_base = base_layout;
    const TensorLayout to_logarithms = logarithms_layout;
    const TensorLayout image_layout = blurry_layout;
    const uint image_width = width;
    const uint right = width - 1;
    const uint bottom = height - 1;
    thresholds[0] = threshold_pair[0];
    thresholds[1] = threshold_pair[1];
    if (2 * x > right) {
        return;
    }
    const uvec2 columns = uvec2(2 * x, min(2 * x + 1, right));
    const uvec2 rows = uvec2(2 * y, min(2 * y + 1, bottom));
    Walks walks;
    walks.before = vec4(-1);
    walks.difference = walks.negatives = walks.count = walks.now = ivec4(0);
    [[unroll]] for (uint i = 0; i < 4; ++i) {
        const uint pixel = rows[i / 2] * image_width + columns[i % 2];
        const uint begin = offsets[pixel];
        const uint end = offsets[pixel + 1];
        const float image = blurry[element(image_layout, 0, rows[i / 2], columns[i % 2])];
        float first;
        uint mark;
        walks.event[i] = begin;
        walks.end[i] = end - begin > BUSY ? begin : end;
        walks.base[i] = begin_walk(begin, walks.end[i], image, first, mark);
        walks.next[i] = first;
        walks.mark[i] = mark;
        bases[element(to_base, 0, rows[i / 2], columns[i % 2])] = walks.base[i];
        context[element(to_context, 0, rows[i / 2], columns[i % 2])] = image;
    }
    for (uint anchor = 0; anchor < ANCHORS; ++anchor) {
        vec4 values;
        const uint last = anchor * WINDOWS_A_GAP;
        for (uint k = anchor == 0 ? 0 : last - WINDOWS_A_GAP + 1; k <= last; ++k) {
            const float time = float(k) * (2.0 / float(WINDOWS)) - 1;
            go_on(walks, time);
            values = vec4(prior_at(walks, 0, time), prior_at(walks, 1, time), prior_at(walks, 2, time),
                          prior_at(walks, 3, time));
            const vec4 logarithm = log(max(values, vec4(0)) + DARK);
            logarithms[element(to_logarithms, k, y, x)] =
                0.25 * (((logarithm.x + logarithm.y) + logarithm.z) + logarithm.w);
            walks.count += k < last ? walks.now : ivec4(0);
        }
        const ivec4 all = walks.count + (anchor == GAPS ? walks.now : ivec4(0));
        const vec4 counts = 0.25 * log2(1 + vec4(min(all, ivec4(MOST_COUNTED))));
        walks.count = walks.now;
        [[unroll]] for (uint i = 0; i < 4; ++i) {
            anchors[element(to_anchors, anchor, rows[i / 2], columns[i % 2])] = values[i];
            if (anchor > 0) {
                context[element(to_context, anchor, rows[i / 2], columns[i % 2])] = counts[i];
            }
        }
    }
}
