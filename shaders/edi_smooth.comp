#version 450

// One axis of a Gaussian of standard deviation 1.5 pixels, cut at 4 and normalised, with the border
// pixels repeated outside:  to(c, p) = sum_k w_k from(c, p + k axis), k = -4 ... 4
//
// from, to   [channels][height][width]
// Precondition: width <= 64 x groups.x, height = groups.y, channels = groups.z.
// Tile: one pixel an invocation, 64 x 1 x 1 a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer From { float from[]; };
layout(std430, binding = 1) writeonly buffer To { float to[]; };

layout(push_constant) uniform Push {
    uint from_origin;
    uint to_origin;
    uint width;
    uint height;
    uint vertical; // 1: along y, 0: along x
};

// exp(-k^2 / 4.5) / sum, k = 0 ... 4
const float WEIGHTS[5] =
    float[](0.26655997, 0.21344454, 0.10958608, 0.036074970, 0.0076144192);

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const uint plane = gl_WorkGroupID.z * height * width;
    const int place = int(vertical != 0 ? y : x);
    const int limit = int(vertical != 0 ? height : width) - 1;
    const uint stride = vertical != 0 ? width : 1;
    const uint line = from_origin + plane + (vertical != 0 ? x : y * width);
    float sum = WEIGHTS[0] * from[line + uint(place) * stride];
    for (int k = 1; k <= 4; ++k) {
        sum += WEIGHTS[k] * (from[line + uint(max(place - k, 0)) * stride] +
                             from[line + uint(min(place + k, limit)) * stride]);
    }
    to[to_origin + plane + y * width + x] = sum;
}
