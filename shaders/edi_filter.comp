#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Along one axis, at every STEP-th pixel from the third on to the last but two, a Gaussian of standard
// deviation 1.5 pixels (SLOPE = 0), or the derivative of what it gives, a central difference over five
// pixels (SLOPE = 1). Outside the image the border pixels repeat.
//
// from       [channels][height][width]
// to         [channels][height][samples], VERTICAL = 1: [channels][samples][width]
// Bindings: 0 from, 1 to.
// Precondition: samples = ceil((length - 4) / STEP) for the length of the axis; channels = groups.z,
// height (VERTICAL = 1: width) <= 64 x groups.x, samples <= RUN x groups.y.
// Tile: RUN samples of one line an invocation, so that a pixel is loaded for all that it is in; 64
// neighbouring lines a workgroup. All is unrolled: the weights are constants of the code.
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint SLOPE = 0;
layout(constant_id = 1) const uint VERTICAL = 0;

layout(std430, binding = 0) readonly buffer From { float from[]; };
layout(std430, binding = 1) writeonly buffer To { float to[]; };

layout(push_constant) uniform Push {
    uint from_origin;
    uint to_origin;
    uint width;
    uint height;
    uint samples;
};

#include "edi_sampling.glsl"

const int REACH = SLOPE == 0 ? 4 : 6;

float gaussian(int k) {
    const float weights[5] = float[](0.26655997, 0.21344454, 0.10958608, 0.036074970, 0.0076144192);
    return abs(k) < 5 ? weights[min(abs(k), 4)] : 0.0;
}

// Weight of the pixel at distance k.
float weight(int k) {
    return SLOPE == 0 ? gaussian(k)
                      : (8 * (gaussian(k - 1) - gaussian(k + 1)) -
                         (gaussian(k - 2) - gaussian(k + 2))) / 12;
}

void main() {
    const uint line = gl_GlobalInvocationID.x;
    if (line >= (VERTICAL != 0 ? width : height)) {
        return;
    }
    const int last = int(VERTICAL != 0 ? height : width) - 1;
    const uint stride = VERTICAL != 0 ? width : 1;
    const uint begin = from_origin + gl_WorkGroupID.z * width * height +
                       line * (VERTICAL != 0 ? 1 : width);
    const int first = int(gl_WorkGroupID.y * RUN); // sample
    float sums[RUN];
    [[unroll]] for (int i = 0; i < int(RUN); ++i) {
        sums[i] = 0;
    }
    [[unroll]] for (int k = -REACH; k <= int(STEP * (RUN - 1)) + REACH; ++k) {
        const float value = from[begin + uint(clamp(2 + int(STEP) * first + k, 0, last)) * stride];
        [[unroll]] for (int i = 0; i < int(RUN); ++i) {
            if (abs(k - int(STEP) * i) <= REACH) {
                sums[i] += weight(k - int(STEP) * i) * value;
            }
        }
    }
    const uint columns = VERTICAL != 0 ? width : samples;
    const uint rows = VERTICAL != 0 ? samples : height;
    const uint out_step = VERTICAL != 0 ? columns : 1;
    const uint at = to_origin + gl_WorkGroupID.z * columns * rows + line * (VERTICAL != 0 ? 1 : columns);
    [[unroll]] for (int i = 0; i < int(RUN); ++i) {
        if (uint(first + i) < samples) {
            to[at + uint(first + i) * out_step] = sums[i];
        }
    }
}
