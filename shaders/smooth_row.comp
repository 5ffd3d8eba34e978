#version 460
// shaders/smooth.comp along both axes at once, for drivers that run on a CPU (lavapipe): the same sums in the
// same order.
//
// With vector loads (shaders/lane_load.glsl), neighbours along x by shuffles with known lanes out of the
// vectors around, and no plane between the axes, the 33 planes of 120x90 that begin the local motion take
// 2.5 ms on Mesa 22.3.6 on one core, all of the motion 3.1 where smooth.comp takes 9.4.
//
// from, to   [channels][height][width]
// Bindings: 0 to; from by address.
// Preconditions: REACH STEP <= LX; `from` readable (any content) up to (PV + 1) LX elements past its end;
//   gl_WorkGroupID below 4096. Workgroup: PV LX pixels of a row of a channel.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_shuffle : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int PV = 8;
layout(constant_id = 2) const int REACH = 4;
layout(constant_id = 3) const int STEP = 1;
layout(constant_id = 4) const uint ZERO = 0;
layout(constant_id = 5) const float W0 = 1;
layout(constant_id = 6) const float W1 = 0;
layout(constant_id = 7) const float W2 = 0;
layout(constant_id = 8) const float W3 = 0;
layout(constant_id = 9) const float W4 = 0;

layout(set = 0, binding = 0, std430) writeonly buffer To { float to[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t from_address;
    uint to_origin;
    uint width;
    uint height;
    uint filler; // to whole 8 bytes, as the host has it
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

// Of the lanes of `middle` and the vectors around, those `shift` further.
float shifted(float before, float middle, float after, int shift) {
    const int lane = int(gl_SubgroupInvocationID);
    const uint from = uint(lane + shift + LX) % uint(LX);
    const float own = subgroupShuffle(middle, from);
    const float other = subgroupShuffle(shift < 0 ? before : after, from);
    return lane + shift >= 0 && lane + shift < LX ? own : other;
}

// Along x, in the row that begins at element `line`.
float filtered(uint line, uint x) {
    const float weights[5] = float[](W0, W1, W2, W3, W4);
    Source source = Source(from_address);
    const float first = ZERO != 0 ? 0 : source.v[line];
    const float last = ZERO != 0 ? 0 : source.v[line + width - 1];
    const float before = load_row(from_address + uint64_t(line + max(x, LX) - LX) * 4ul);
    const float middle = load_row(from_address + uint64_t(line + x) * 4ul);
    const float after = load_row(from_address + uint64_t(line + x + LX) * 4ul);
    const int place = int(x + gl_SubgroupInvocationID);
    float sum = weights[0] * middle;
    [[unroll]] for (int k = 1; k <= REACH; ++k) {
        const float left = shifted(before, middle, after, -k * STEP);
        const float right = shifted(before, middle, after, k * STEP);
        const float low = place >= k * STEP ? left : first;
        const float high = place + k * STEP < width ? right : last;
        sum += weights[k] * (low + high);
    }
    return sum;
}

void main() {
    const float weights[5] = float[](W0, W1, W2, W3, W4);
    const uint begin = uniform_id(gl_WorkGroupID.x) * (PV * LX);
    const int y = int(uniform_id(gl_WorkGroupID.y));
    const uint plane = uniform_id(gl_WorkGroupID.z) * (width * height);
    const int bottom = int(height) - 1;
    [[unroll]] for (int v = 0; v < PV; ++v) {
        const uint x = begin + v * LX;
        float sum = weights[0] * filtered(plane + uint(y) * width, x);
        [[unroll]] for (int k = 1; k <= REACH; ++k) {
            const int above = y - k * STEP;
            const int below = y + k * STEP;
            float low = filtered(plane + uint(max(above, 0)) * width, x);
            float high = filtered(plane + uint(min(below, bottom)) * width, x);
            low = ZERO != 0 && above < 0 ? 0 : low;
            high = ZERO != 0 && below > bottom ? 0 : high;
            sum += weights[k] * (low + high);
        }
        const uint column = x + gl_SubgroupInvocationID;
        const uint target = to_origin + plane + uint(y) * width + column;
        if (column < width) {
            to[target] = sum;
        }
    }
}
