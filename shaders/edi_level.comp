#version 450

// ln(L + e) at the exposure's start, as the double integral of edi.comp gives it, averaged over
// BIN x BIN pixels:
//     level = ln(B + e) - ln(mean over [-1, 1] of exp(E)),    e = 0.01
// STILL = 1: ln(B + e) alone. |E| is cut at 80, far beyond what a scene's contrast can be. A pixel with
// more than BUSY events counts as one without, see edi_counts.comp.
//
// offsets     [sensor pixels + 1]: events of pixel p are offsets[p] ... offsets[p + 1] - 1
// event_times [events] ascending within a pixel, in [-1, 1]
// marks       [events]: polarity << 31 | ordinal
// blurry      [sensor height][sensor width]
// thresholds  [2]: c+, c-
// level       [height][width]
// Bindings: as listed.
// Precondition: sensor >= BIN (width, height); width <= 64 x groups.x, height = groups.y.
// Tile: one binned pixel an invocation, 64 x 1 a workgroup.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint BIN = 1;
layout(constant_id = 1) const uint BUSY = 4096;
layout(constant_id = 2) const uint STILL = 0;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 4) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 5) writeonly buffer Level { float level[]; };

layout(push_constant) uniform Push {
    uint blurry_origin;
    uint level_origin;
    uint width; // binned
    uint sensor_width;
};

const float SMALL = 0.01; // e
const float LARGEST = 80; // of |E|: exp() of it and of its negative are finite and not 0

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const vec2 steps = vec2(thresholds[0], -thresholds[1]);
    float sum = 0;
    for (uint part = 0; part < BIN * BIN; ++part) {
        const uint pixel = (y * BIN + part / BIN) * sensor_width + x * BIN + part % BIN;
        sum += log(blurry[blurry_origin + pixel] + SMALL);
        if (STILL != 0) {
            continue;
        }
        const uint begin = offsets[pixel];
        const uint stop = offsets[pixel + 1];
        const uint end = stop - begin > BUSY ? begin : stop;
        float integral = 0;
        vec2 count = vec2(0); // N+, N-
        float value = 1;      // exp(E)
        float last = -1;
        for (uint event = begin; event < end; ++event) {
            const float time = event_times[event];
            integral += value * (time - last);
            last = time;
            count += (marks[event] >> 31) != 0 ? vec2(1, 0) : vec2(0, 1);
            value = exp(clamp(dot(steps, count), -LARGEST, LARGEST));
        }
        integral += value * (1 - last);
        sum -= log(0.5 * integral);
    }
    level[level_origin + y * width + x] = sum / float(BIN * BIN);
}
