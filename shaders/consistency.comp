#version 450
#extension GL_GOOGLE_include_directive : require
#include "fusion_constants.glsl"

// What one frame adds to the data consistency of an exposure (layers/consistency.hpp), with its share of the
// exposure:
//     sum  = sum - share (frame - prior)
//     most = max(most, frame, blurry)
// and sum = 0 where most >= limit, which is infinite but for the last frame.
//
// frame, prior, blurry   1 channel, block 1, any halo and pitch
// instant   layers/instant.hpp, of which the share counts
// state     [2][height][width]: sum, most; zeros before the first frame
// Bindings: 0 frame, 1 prior, 2 blurry, 3 instant, 4 state.
// Precondition: width <= 64 x groups.x, height = groups.y.
// Tile: one pixel an invocation, 64 x 1 a workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Frame { float frame[]; };
layout(std430, binding = 1) readonly buffer Prior { float prior[]; };
layout(std430, binding = 2) readonly buffer Blurry { float blurry[]; };
layout(std430, binding = 3) readonly buffer Instant { float instant[]; };
layout(std430, binding = 4) buffer State { float state[]; };

layout(push_constant) uniform Push {
    uint frame_origin;
    uint frame_row;
    uint prior_origin;
    uint prior_row;
    uint blurry_origin;
    uint blurry_row;
    uint instant_origin;
    uint state_origin;
    uint width;
    uint height;
    float limit;
};

void main() {
    const uint column = gl_GlobalInvocationID.x;
    const uint x = min(column, width - 1);
    const uint y = gl_WorkGroupID.y;
    const float share = instant[instant_origin + INSTANT_SHARE];
    const float value = frame[frame_origin + y * frame_row + x];
    const float change = value - prior[prior_origin + y * prior_row + x];
    const uint at = state_origin + y * width + x;
    const uint second = at + width * height;
    const float sum = state[at] - share * change;
    const float most = max(state[second], max(value, blurry[blurry_origin + y * blurry_row + x]));
    const float kept = most < limit ? sum : 0;
    if (column < width) {
        state[at] = kept;
        state[second] = most;
    }
}
