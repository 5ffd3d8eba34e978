// The event-driven prior of one pixel (tools/train/prior.py), for kernels that include
// edi_steps.glsl. With the level E_i after i events of which the last was at t_i (t_0 = -1), and the
// step d_i of the next event at t_{i+1}:
//     E(t) = E_i + d_i clamp((t - t_{i+1}) / min(t_{i+1} - t_i, RAMP) + 1, 0, 1)
//     L(t) = min(exp(min(b + E(t), 2)) - e, LARGEST),   b = ln(B + e) - ln(mean of exp(E))

const float RAMP = 0.05; // normalised time
const float LARGEST = 2;
const float LARGEST_LOGARITHM = 2;
const float AFTER = 2; // a time later than any frame

float step_of(uint mark) {
    return (mark >> 31) != 0 ? thresholds[0] : -thresholds[1];
}

// What the level has of the step of the event at `after`, the one before it being at `before`.
float ramp(float time, float before, float after) {
    const float width = max(min(after - before, RAMP), 1e-9);
    return clamp((time - after) / width + 1, 0, 1);
}

float prior_value(float logarithm) {
    return min(exp(min(logarithm, LARGEST_LOGARITHM)) - SMALL, LARGEST);
}
