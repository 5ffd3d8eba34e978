#version 450
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"

// The double integral of edi.comp for pixels with very many events: a workgroup a pixel. Each
// invocation takes a run of consecutive events, integrates it from E = 0, and the runs are chained.
//
// busy        [1 + slots]: how many pixels, and which; the others as in edi.comp
// Precondition: groups.x >= busy[0].
// Tile: one pixel, its events in 128 runs.
layout(local_size_x = 128) in;

layout(std430, binding = 0) readonly buffer Offsets { uint offsets[]; };
layout(std430, binding = 1) readonly buffer EventTimes { float event_times[]; };
layout(std430, binding = 2) readonly buffer Marks { uint marks[]; };
layout(std430, binding = 3) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 4) readonly buffer Schedule { uint schedule[]; };
layout(std430, binding = 5) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 6) readonly buffer Busy { uint busy[]; };
layout(std430, binding = 7) writeonly buffer Frames { float frames[]; };

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

const uint RUNS = 128;

shared ivec2 run_state[RUNS]; // change of a run; then the state at its start
shared ivec2 run_peak[RUNS];
shared float run_sum[RUNS];
shared uint run_empty[RUNS];
shared ivec2 peak;
shared float ln_mean; // ln of the mean over the exposure of exp(E - E(peak))

void main() {
    if (gl_WorkGroupID.x >= busy[0]) {
        return;
    }
    const uint run = gl_LocalInvocationID.x;
    const uint pixel = busy[1 + gl_WorkGroupID.x];
    const uint all = offsets[pixel];
    const uint stop = offsets[pixel + 1];
    const uint length_ = (stop - all + RUNS - 1) / RUNS;
    const uint begin = min(all + run * length_, stop);
    const uint end = min(begin + length_, stop);

    // The pieces that end at the run's events.
    Integral part = Integral(ivec2(0), 0, true);
    ivec2 state = ivec2(0);
    float last = begin == all ? -1 : event_times[begin - 1];
    for (uint event = begin; event < end; ++event) {
        const float time = event_times[event];
        add_piece(part, state, time - last);
        last = time;
        state = next_state(state, marks[event]);
    }
    run_state[run] = state;
    run_peak[run] = part.peak;
    run_sum[run] = part.sum;
    run_empty[run] = part.empty ? 1 : 0;
    barrier();

    if (run == 0) {
        Integral total = Integral(ivec2(0), 0, true);
        ivec2 start = ivec2(0);
        for (uint i = 0; i < RUNS; ++i) {
            if (run_empty[i] == 0) {
                // As one piece at the run's peak: its sum is relative to that.
                add_piece(total, start + run_peak[i], run_sum[i]);
            }
            const ivec2 change = run_state[i];
            run_state[i] = start;
            start += change;
        }
        add_piece(total, start, 1 - event_times[stop - 1]);
        peak = total.peak;
        ln_mean = log(0.5 * total.sum);
    }
    barrier();

    if (begin == end) {
        return;
    }
    const uint row = pixel / width;
    const uint column = pixel % width;
    const float base =
        log(blurry[element(blurry_layout, blurry_channel, row, column)] + SMALL) - ln_mean;
    state = run_state[run];
    uint event = begin;
    for (uint k = 0; k < count; ++k) {
        const float time = uintBitsToFloat(schedule[k]);
        // The frame is this run's when the events up to its time end inside the run.
        const bool after = begin == all || event_times[begin - 1] <= time;
        const bool before = end == stop || event_times[end - 1] > time;
        if (!after || !before) {
            continue;
        }
        while (event < end && event_times[event] <= time) {
            state = next_state(state, marks[event]);
            ++event;
        }
        const uint frame = schedule[count + k];
        if (frame >= first && frame - first < limit) {
            frames[element(frames_layout, frame - first, row, column)] =
                exp(min(base + exponent(state - peak), LARGEST_EXPONENT)) - SMALL;
        }
    }
}
