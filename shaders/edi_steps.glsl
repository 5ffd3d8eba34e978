// The steps E(t) of a pixel and the integral of their exponential, for kernels that declare
// thresholds[2] = c+, c-.

const float SMALL = 0.01;          // e
const float LARGEST_EXPONENT = 80; // exp() of it is finite, also times a white pixel

// (N+ - N-, N-): E is the sum of two terms of which the second is small for like thresholds.
float exponent(ivec2 state) {
    return thresholds[0] * float(state.x) + (thresholds[0] - thresholds[1]) * float(state.y);
}

ivec2 next_state(ivec2 state, uint mark) {
    return (mark >> 31) != 0 ? state + ivec2(1, 0) : state + ivec2(-1, 1);
}

// Integral of exp(E - E(peak)) over the pieces so far.
struct Integral {
    ivec2 peak;
    float sum;
    bool empty;
};

void add_piece(inout Integral integral, ivec2 state, float span) {
    if (span <= 0) {
        return;
    }
    const float rise = exponent(state - integral.peak);
    const bool higher = integral.empty || rise > 0;
    const float smaller = exp(-abs(rise)); // once: lavapipe runs both sides of a branch
    integral.sum = higher ? (integral.empty ? 0 : integral.sum * smaller) + span
                          : integral.sum + smaller * span;
    integral.peak = higher ? state : integral.peak;
    integral.empty = false;
}
