#version 460
// shaders/prior_frame.comp for drivers that run on a CPU (lavapipe): the same planes, but each pixel's place
// among its events is kept from one wanted time to the next, so that an exposure's frames in order of time
// walk over its events once. Any order gives the same.
//
// What makes it fast there, measured on Mesa 22.3.6 at 240x180 with 100,000 events and 14 frames on one core,
// 1.25 ms a frame against 3.0 of prior_frame.comp:
// - all that lies by pixel comes by vector loads (shaders/lane_load.glsl), only events by the lanes' own;
// - VECTORS vectors of pixels share a loop over what events any of them passes: the driver runs the body of a
//   loop at least once, with no lane active;
// - from the first loop on it makes every load lane by lane, so that one comes last but for the stores.
//
// state      [3][height][width], zeros before the first frame of an exposure, then this kernel's own:
//            word: 1 + events up to the last wanted time | positive ones of them << 11
//                | the last of them is positive << 30 | the next event is positive << 31;
//            time of the last of them, or -1; time of the next, or AFTER
// The others as in prior_frame.comp, block 1.
// Bindings: 0 planes, 1 state; everything else by address.
// Preconditions: what is read by address readable (any content) up to 2 VECTORS LX elements past its end;
//   BUSY at most 1023; gl_WorkGroupID below 4096. Workgroup: VECTORS LX pixels of a row.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#include "fusion_constants.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int VECTORS = 5;
layout(constant_id = 2) const uint BUSY = 768;

layout(set = 0, binding = 0, std430) writeonly buffer Planes { float planes[]; };
layout(set = 0, binding = 1, std430) writeonly buffer State { uint state[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t state_address;
    uint64_t offsets_address;
    uint64_t times_address;
    uint64_t marks_address;
    uint64_t blurry_address;
    uint64_t base_address;
    uint64_t thresholds_address;
    uint64_t instant_address;
    uint blurry_row; // elements
    uint base_row;
    uint planes_origin;
    uint planes_row;
    uint planes_plane;
    uint state_origin;
    uint width;
    uint height;
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

float thresholds[2];

#include "edi_steps.glsl"
#include "prior_steps.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Words { uint v[]; };

const vec2 DECAY = vec2(0.04, 0.25);
const uint COUNT = 2047; // mask of the word's counts
const uint POSITIVES = 11;
const uint LAST = 30;
const uint NEXT = 31;

uint load_word(uint64_t address, uint at) {
    return floatBitsToUint(load_lanes(address, at, 1));
}

void main() {
    const uint lane = gl_SubgroupInvocationID;
    const uint x = uniform_id(gl_WorkGroupID.x) * (VECTORS * LX);
    const uint y = uniform_id(gl_WorkGroupID.y);
    const uint pixel = y * width + x;
    const uint area = width * height;
    const float time = Source(instant_address).v[INSTANT_TIME];
    thresholds[0] = Source(thresholds_address).v[0];
    thresholds[1] = Source(thresholds_address).v[1];

    uint begin[VECTORS], total[VECTORS], word[VECTORS];
    float before[VECTORS], after[VECTORS], base[VECTORS], image[VECTORS];
    [[unroll]] for (int v = 0; v < VECTORS; ++v) {
        const uint at = pixel + v * LX;
        begin[v] = load_word(offsets_address, at);
        total[v] = load_word(offsets_address, at + 1) - begin[v];
        total[v] = total[v] > BUSY ? 0 : total[v];
        word[v] = load_word(state_address, at);
        before[v] = load_lanes(state_address, area + at, 1);
        after[v] = load_lanes(state_address, 2 * area + at, 1);
        base[v] = load_lanes(base_address, y * base_row + x + v * LX, 1);
        image[v] = load_lanes(blurry_address, y * blurry_row + x + v * LX, 1);
        const bool beyond = x + v * LX + lane >= width; // nothing to do
        word[v] = beyond ? 1 : word[v];
        before[v] = beyond ? -1 : before[v];
        after[v] = beyond ? AFTER : after[v];
    }
    // Push constants for what is behind branches, where the driver reads them lane by lane.
    Source times = Source(times_address);
    Words marks = Words(marks_address);
    const uint own_state = state_origin + pixel + lane;
    const uint target = planes_origin + y * planes_row + x + lane;
    const uint plane = planes_plane;
    const uint right = width;

    // One event at a time of those that each lane still has to pass, in either direction.
    bool more;
    do {
        uint vector = VECTORS;
        uint own = 0;
        uint first = 0;
        uint all = 0;
        float earlier = 0;
        float later = 0;
        [[unroll]] for (int v = VECTORS - 1; v >= 0; --v) {
            const bool waits = (word[v] & COUNT) == 0 || after[v] <= time || before[v] > time;
            vector = waits ? v : vector;
            own = waits ? word[v] : own;
            first = waits ? begin[v] : first;
            all = waits ? total[v] : all;
            earlier = waits ? before[v] : earlier;
            later = waits ? after[v] : later;
        }
        more = vector < VECTORS;
        if (more) {
            const bool fresh = (own & COUNT) == 0;
            const bool forward = fresh || later <= time;
            uint passed = fresh ? 0 : (own & COUNT) - 1;
            uint positive = own >> POSITIVES & COUNT;
            uint last_sign = own >> LAST & 1;
            uint next_sign = own >> NEXT;
            passed += fresh ? 0 : (forward ? 1 : -1);
            positive += fresh ? 0 : (forward ? next_sign : -last_sign);
            const bool exists = forward ? passed < all : passed > 0;
            float found = forward ? AFTER : -1;
            uint found_sign = 0;
            if (exists) {
                const uint event = first + passed - (forward ? 0 : 1);
                found = times.v[event];
                found_sign = marks.v[event] >> 31;
            }
            const float passing = forward ? later : earlier;
            const uint passing_sign = forward ? next_sign : last_sign;
            later = forward ? found : passing;
            next_sign = forward ? found_sign : passing_sign;
            earlier = forward ? (fresh ? -1 : passing) : found;
            last_sign = forward ? (fresh ? 0 : passing_sign) : found_sign;
            own = passed + 1 | positive << POSITIVES | last_sign << LAST | next_sign << NEXT;
            const uint place = own_state + vector * LX;
            state[place] = own;
            state[place + area] = floatBitsToUint(earlier);
            state[place + 2 * area] = floatBitsToUint(later);
        }
        [[unroll]] for (int v = 0; v < VECTORS; ++v) {
            word[v] = v == vector ? own : word[v];
            before[v] = v == vector ? earlier : before[v];
            after[v] = v == vector ? later : after[v];
        }
    } while (more);

    [[unroll]] for (int v = 0; v < VECTORS; ++v) {
        const int passed = int(word[v] & COUNT) - 1;
        const int positive = int(word[v] >> POSITIVES & COUNT);
        const float step_before = passed > 0 ? step_of(word[v] << NEXT - LAST) : 0;
        const float step_after = passed < total[v] ? step_of(word[v]) : 0;
        const float level = exponent(ivec2(2 * positive - passed, passed - positive)) +
                            step_after * ramp(time, before[v], after[v]);
        const float value = prior_value(base[v] + level);
        const vec2 near = (value + SMALL) * step_before * exp((before[v] - time) / DECAY);
        const vec2 far = (value + SMALL) * step_after * exp((time - after[v]) / DECAY);
        const uint at = target + v * LX;
        if (x + v * LX + lane < right) {
            planes[at + PLANE_PRIOR * plane] = value;
            planes[at + PLANE_BLURRY * plane] = image[v];
            planes[at + PLANE_SURFACES * plane] = near.x;
            planes[at + (PLANE_SURFACES + 1) * plane] = near.y;
            planes[at + (PLANE_SURFACES + 2) * plane] = far.x;
            planes[at + (PLANE_SURFACES + 3) * plane] = far.y;
            planes[at + PLANE_TIME * plane] = time * time;
        }
    }
}
