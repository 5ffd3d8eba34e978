#version 450
#extension GL_GOOGLE_include_directive : require
#include "fusion_constants.glsl"

// The trunk's features for the head at a wanted time t, a polynomial of degree 3 in it:
//     mixed = sum over k of T_k(t) features(k),   T = 1, t, 2 t^2 - 1, 4 t^3 - 3 t (Chebyshev)
//
// features   4 tensors of the layout of `mixed` one after the other
// instant    layers/instant.hpp, of which word 0, the time, counts
// mixed      any order of a multiple of 4 elements, so that vec4 `size` of them are all
// Bindings: 0 features, 1 instant, 2 mixed. Origins in vec4, of the instant in words.
// Precondition: size <= 64 x groups.x x groups.y.
// Tile: 4 elements an invocation.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Features { vec4 features[]; };
layout(std430, binding = 1) readonly buffer Instant { uint instant[]; };
layout(std430, binding = 2) writeonly buffer Mixed { vec4 mixed[]; };

layout(push_constant) uniform Push {
    uint features_origin;
    uint instant_origin;
    uint mixed_origin;
    uint size;
};

void main() {
    const uint i = gl_WorkGroupID.y * gl_NumWorkGroups.x * 64 + gl_GlobalInvocationID.x;
    if (i >= size) {
        return;
    }
    const float t = uintBitsToFloat(instant[instant_origin + INSTANT_TIME]);
    const uint at = features_origin + i;
    mixed[mixed_origin + i] = features[at] + t * features[at + size] +
                              (2 * t * t - 1) * features[at + 2 * size] +
                              ((4 * t * t - 3) * t) * features[at + 3 * size];
}
