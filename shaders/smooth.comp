#version 450
#extension GL_EXT_control_flow_attributes : require

// One axis of a symmetric filter:
//     to(c, p) = sum over |k| <= REACH of W_|k| from(c, p + k STEP axis)
// Outside the image the border pixels repeat (ZERO = 0), or are 0 (ZERO = 1).
//
// from, to   [channels][height][width]
// Bindings: 0 from, 1 to.
// Precondition: width <= 64 x groups.x, height = groups.y, channels = groups.z; REACH <= 4.
// Tile: one pixel an invocation, 64 x 1 x 1 a workgroup.
layout(local_size_x = 64) in;
layout(constant_id = 0) const int REACH = 4;
layout(constant_id = 1) const int STEP = 1;
layout(constant_id = 2) const uint ZERO = 0;
layout(constant_id = 3) const float W0 = 1;
layout(constant_id = 4) const float W1 = 0;
layout(constant_id = 5) const float W2 = 0;
layout(constant_id = 6) const float W3 = 0;
layout(constant_id = 7) const float W4 = 0;

layout(std430, binding = 0) readonly buffer From { float from[]; };
layout(std430, binding = 1) writeonly buffer To { float to[]; };

layout(push_constant) uniform Push {
    uint from_origin;
    uint to_origin;
    uint width;
    uint height;
    uint vertical; // 1: along y, 0: along x
};

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_WorkGroupID.y;
    if (x >= width) {
        return;
    }
    const float weights[5] = float[](W0, W1, W2, W3, W4);
    const uint plane = gl_WorkGroupID.z * height * width;
    const int place = int(vertical != 0 ? y : x);
    const int limit = int(vertical != 0 ? height : width) - 1;
    const uint stride = vertical != 0 ? width : 1;
    const uint line = from_origin + plane + (vertical != 0 ? x : y * width);
    float sum = weights[0] * from[line + uint(place) * stride];
    [[unroll]] for (int k = 1; k <= REACH; ++k) {
        const int low = place - k * STEP;
        const int high = place + k * STEP;
        float first = from[line + uint(max(low, 0)) * stride];
        float second = from[line + uint(min(high, limit)) * stride];
        if (ZERO != 0) {
            first = low >= 0 ? first : 0;
            second = high <= limit ? second : 0;
        }
        sum += weights[k] * (first + second);
    }
    to[to_origin + plane + y * width + x] = sum;
}
