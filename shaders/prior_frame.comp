#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"
#include "fusion_constants.glsl"

// What the head of the fusion network sees of the event-driven prior (prior_steps.glsl) at a wanted
// time t, as channels of its input:
//     planes(0)  = L(t)
//     planes(1)  = B
//     planes(11 + i) = s (L(t) + 0.01) exp(-|t - t_before| / DECAY[i]),  i = 0, 1
//     planes(13 + i) = s (L(t) + 0.01) exp(-|t - t_after| / DECAY[i])
//     planes(15) = t^2
// t_before is the pixel's last event up to and including t, t_after the first one later, s the step
// c+ or -c- of that event, 0 where there is none.
// Pixels with more than BUSY events are taken as pixels without events.
//
// offsets, event_times, marks, thresholds as in prior.comp
// positives  [events + 1]: positive events before each, for the level at any event
// blurry     1 channel, any layout
// base       1 channel, any layout: b, from prior.comp
// instant    layers/instant.hpp, of which word 0, the time, counts
// planes     16 channels, any layout
// Bindings: 0 offsets, 1 event_times, 2 marks, 3 positives, 4 blurry, 5 thresholds, 6 base, 7 instant,
//   8 planes.
// Precondition: width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 a workgroup.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BUSY = 768;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) readonly buffer Positives { uint positives[]; };
layout(std430, binding = 4) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 5) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 6) readonly buffer Base { float bases[]; };
layout(std430, binding = 7) readonly buffer Instant { uint instant[]; };
layout(std430, binding = 8) writeonly buffer Planes { float planes[]; };

layout(push_constant) uniform Push {
    TensorLayout blurry_layout;
    TensorLayout base_layout;
    TensorLayout planes_layout;
    uint instant_origin;
    uint width;
};

#include "edi_steps.glsl"
#include "prior_steps.glsl"

const vec2 DECAY = vec2(0.04, 0.25);

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const float time = uintBitsToFloat(instant[instant_origin + INSTANT_TIME]);
    const uint pixel = y * width + x;
    const uint begin = offsets[pixel];
    uint end = offsets[pixel + 1];
    if (end - begin > BUSY) {
        end = begin;
    }
    // The first event after `time`, by bisection.
    uint event = begin;
    for (uint beyond = end; event < beyond;) {
        const uint middle = event + (beyond - event) / 2;
        if (event_times[middle] <= time) {
            event = middle + 1;
        } else {
            beyond = middle;
        }
    }

    float before = -1;
    float after = AFTER;
    float step_before = 0;
    float step_after = 0;
    ivec2 state = ivec2(0);
    if (event > begin) {
        before = event_times[event - 1];
        step_before = step_of(marks[event - 1]);
        const int all = int(event - begin);
        const int positive = int(positives[event] - positives[begin]);
        state = ivec2(2 * positive - all, all - positive);
    }
    if (event < end) {
        after = event_times[event];
        step_after = step_of(marks[event]);
    }
    const float level = exponent(state) + step_after * ramp(time, before, after);
    const float value = prior_value(bases[element(base_layout, 0, y, x)] + level);
    const vec2 near = (value + SMALL) * step_before * exp((before - time) / DECAY);
    const vec2 far = (value + SMALL) * step_after * exp((time - after) / DECAY);

    planes[element(planes_layout, PLANE_PRIOR, y, x)] = value;
    planes[element(planes_layout, PLANE_BLURRY, y, x)] = blurry[element(blurry_layout, 0, y, x)];
    planes[element(planes_layout, PLANE_SURFACES, y, x)] = near.x;
    planes[element(planes_layout, PLANE_SURFACES + 1, y, x)] = near.y;
    planes[element(planes_layout, PLANE_SURFACES + 2, y, x)] = far.x;
    planes[element(planes_layout, PLANE_SURFACES + 3, y, x)] = far.y;
    planes[element(planes_layout, PLANE_TIME, y, x)] = time * time;
}
