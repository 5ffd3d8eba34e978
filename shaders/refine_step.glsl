// The gradient step on equation 8 at one pixel of frame i (layers/refine.hpp), sum being that of alpha_net
// before its ReLU, `before` and `after` L_{i-1} and L_{i+1}, and residual_* the residual between them and L_i.
float refine_step(float sum, float largest_step, float value, float start, bool has_before, float before,
                  float residual_before, bool has_after, float after, float residual_after) {
    float direction = 2 * (value - start);
    direction -= has_before ? 2 * (before + residual_before - value) : 0.0;
    direction += has_after ? 2 * (value + residual_after - after) : 0.0;
    return value - min(0.1 * max(sum, 0.0), largest_step) * direction;
}
