#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "tensor.glsl"

// Intensity curve (equations 3, 6 and 7): with derivatives y_i at keypoints t_i and fixed nodes x_k,
//     P(x_k) = sum_i y_i w_i prod_{j != i} (x_k - t_j),    w_i = 1 / prod_{j != i} (t_i - t_j)
//     L(f)   = B + sum_k S(f, k) P(x_k)
// and with ordered = 1, where e events fell in the 3x3 pixels around, the degree of L in time is min(n, e):
//     L(f)   = B + sum_{j < e} T(f, j) sum_k C(j, k) P(x_k)
// P cut off after its first terms in Legendre polynomials, which is the nearest polynomial of the degree.
// Every difference is doubled: products of n - 1 of them stay near 1 for points spread over [-1, 1]
// (capacity 1/2), far from the ends of float32's range. See layers/curve.hpp for the error bound.
//
// derivatives, keypoints  any layouts, n channels from *_channel; keypoints ascend
// blurry                  any layout, channel blurry_channel
// matrix                  nodes [n], then S [frames][n]; ordered: nodes [n], C [n][n], T [frames][n]
// offsets                 ordered: [height * width + 1], events of pixel p are offsets[p] ... offsets[p + 1] - 1
// frames                  any layout, `count` channels: rows `row`, row + 1, ... of S
// Precondition: count <= FRAMES; width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 pixels a workgroup; loops over n and FRAMES unrolled. All loads come
// before the only branch: behind one lavapipe makes them lane by lane, which takes twice the time.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint n = 10;
layout(constant_id = 1) const uint spaced = 1; // 1: keypoints are spread to `spacing` first
layout(constant_id = 2) const uint ordered = 0;

const uint FRAMES = 16;

layout(std430, binding = 0) readonly buffer Derivatives { float derivatives[]; };
layout(std430, binding = 1) readonly buffer Keypoints { float keypoints[]; };
layout(std430, binding = 2) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 3) readonly buffer Matrix { float matrix[]; };
layout(std430, binding = 4) writeonly buffer Frames { float frames[]; };
layout(std430, binding = 5) readonly buffer Offsets { uint offsets[]; };

layout(push_constant) uniform Push {
    TensorLayout derivatives_layout;
    TensorLayout keypoints_layout;
    TensorLayout blurry_layout;
    TensorLayout frames_layout;
    uint width;
    uint height;
    uint derivative_channel;
    uint keypoint_channel;
    uint blurry_channel;
    uint row;
    uint count;
    float spacing;
};

// Keypoints that float32 cannot tell apart count as this far apart, so that the result stays finite.
const float CLOSEST = 1.0 / 16777216.0;

// min(n, events of the 3x3 pixels around).
uint order_at(uint x, uint y) {
    const uint left = max(x, 1) - 1;
    const uint right = min(x + 1, width - 1);
    uint events = 0;
    [[unroll]] for (int dy = -1; dy <= 1; ++dy) {
        const int row_of = clamp(int(y) + dy, 0, int(height) - 1);
        const uint begin = uint(row_of) * width;
        events += row_of == int(y) + dy ? offsets[begin + right + 1] - offsets[begin + left] : 0;
    }
    return min(events, n);
}

void main() {
    const uint column = gl_GlobalInvocationID.x;
    const uint x = min(column, width - 1);
    const uint y = gl_WorkGroupID.y;
    float t[n];
    [[unroll]] for (uint i = 0; i < n; ++i) {
        t[i] = keypoints[element(keypoints_layout, keypoint_channel + i, y, x)];
    }
    if (spaced != 0) {
        [[unroll]] for (uint i = 1; i < n; ++i) {
            t[i] = max(t[i], t[i - 1] + spacing);
        }
        const bool over = t[n - 1] > 1;
        t[n - 1] = min(t[n - 1], 1.0);
        [[unroll]] for (uint i = n - 1; i > 0; --i) {
            t[i - 1] = over ? min(t[i - 1], t[i] - spacing) : t[i - 1];
        }
    }

    float weighted[n]; // y_i w_i
    [[unroll]] for (uint i = 0; i < n; ++i) {
        float product = 1;
        [[unroll]] for (uint j = 0; j < n; ++j) {
            if (j < i) {
                product *= 2 * max(t[i] - t[j], CLOSEST);
            } else if (j > i) {
                product *= 2 * min(t[i] - t[j], -CLOSEST);
            }
        }
        weighted[i] =
            derivatives[element(derivatives_layout, derivative_channel + i, y, x)] / product;
    }

    float value[n]; // P(x_k)
    [[unroll]] for (uint k = 0; k < n; ++k) {
        const float node = matrix[k];
        float after[n]; // product over j > i
        after[n - 1] = 1;
        [[unroll]] for (uint i = n - 1; i > 0; --i) {
            after[i - 1] = after[i] * (2 * (node - t[i]));
        }
        float before = 1;
        float sum = 0;
        [[unroll]] for (uint i = 0; i < n; ++i) {
            sum += weighted[i] * (before * after[i]);
            before *= 2 * (node - t[i]);
        }
        value[k] = sum;
    }

    uint rows = 1; // before those of frame 0
    if (ordered != 0) {
        const uint order = order_at(x, y);
        float term[n];
        [[unroll]] for (uint j = 0; j < n; ++j) {
            term[j] = 0;
            [[unroll]] for (uint k = 0; k < n; ++k) {
                term[j] += matrix[(1 + j) * n + k] * value[k];
            }
        }
        [[unroll]] for (uint j = 0; j < n; ++j) {
            value[j] = j < order ? term[j] : 0;
        }
        rows += n;
    }

    const float mean = blurry[element(blurry_layout, blurry_channel, y, x)];
    float found[FRAMES];
    [[unroll]] for (uint f = 0; f < FRAMES; ++f) {
        const uint own = (rows + row + min(f, count - 1)) * n;
        found[f] = mean;
        [[unroll]] for (uint k = 0; k < n; ++k) {
            found[f] += matrix[own + k] * value[k];
        }
    }
    const uint target = element(frames_layout, 0, y, x);
    const uint plane = frames_layout.plane;
    const uint last = count;
    if (column < width) {
        [[unroll]] for (uint f = 0; f < FRAMES; ++f) {
            if (f < last) {
                frames[target + f * plane] = found[f];
            }
        }
    }
}
