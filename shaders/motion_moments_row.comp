#version 460
// shaders/motion_moments.comp for drivers that run on a CPU (lavapipe): the same moments, a lane a pixel with
// vector loads (shaders/lane_load.glsl), each cell's columns added up by shuffles at the end.
// On Mesa 22.3.6 the gaps of 120x90 take 1.1 ms on one core, 6.0 there.
//
// Bindings: 0 moments; frames by address.
// Preconditions: LX a multiple of 4; frames readable (any content) up to LX elements past their end;
//   gl_WorkGroupID below 4096. Workgroup: LX / 4 cells of a row of them, of one gap.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "fusion_constants.glsl"
#include "motion_steps.glsl"

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;

layout(set = 0, binding = 0, std430) writeonly buffer MomentPlanes { float planes[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t frames_address;
    uint moments_origin;
    uint width;
    uint height;
    uint columns;
    uint rows;
    uint filler; // to whole 8 bytes, as the host has it
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

float over_cell(float value) {
    value += subgroupShuffleXor(value, 1);
    return value + subgroupShuffleXor(value, 2);
}

void main() {
    const uint lane = gl_SubgroupInvocationID;
    const uint x = uniform_id(gl_WorkGroupID.x) * LX;
    const uint row = uniform_id(gl_WorkGroupID.y);
    const uint gap = uniform_id(gl_WorkGroupID.z);
    const uint plane = width * height;
    Source source = Source(frames_address);

    Moments moments = Moments(vec3(0), vec2(0));
    [[unroll]] for (uint r = 0; r < SIDE; ++r) {
        const uint y = min(SIDE * row + r, height - 1);
        const float counts = SIDE * row + r < height ? 1 : 0;
        float early = 0;
        vec2 early_slope = vec2(0);
        [[unroll]] for (uint k = 0; k <= WINDOWS_A_GAP; ++k) {
            const uint at = (gap * WINDOWS_A_GAP + k) * plane + y * width + x;
            const float late = load_row(frames_address + uint64_t(at) * 4ul);
            const float above = load_row(frames_address + uint64_t(at - (y > 0 ? width : 0)) * 4ul);
            const float below = load_row(frames_address + uint64_t(at + (y + 1 < height ? width : 0)) * 4ul);
            const float before = source.v[at - min(x, 1)];
            const float after = source.v[at + LX];
            const float within_left = subgroupShuffle(late, max(lane, 1) - 1);
            const float within_right = subgroupShuffle(late, min(lane + 1, LX - 1));
            const float left = lane == 0 ? before : within_left;
            const float right = lane + 1 < LX ? within_right : after;
            const vec2 late_slope = vec2((x + lane + 1 < width ? right : late) - left, below - above);
            if (k > 0) {
                add_equation(moments, 0.125 * (early_slope + late_slope), late - early,
                             counts / float(WINDOWS_A_GAP));
            }
            early = late;
            early_slope = late_slope;
        }
    }
    const bool inside = x + lane < width;
    const float share = 1.0 / float(SIDE * SIDE);
    const float sums[5] = float[](moments.gg.x, moments.gg.y, moments.gg.z, moments.gd.x, moments.gd.y);
    const uint step = GAPS * rows * columns;
    const uint column = (x + lane) / SIDE;
    const uint target = moments_origin + (gap * rows + row) * columns + column;
    const bool mine = lane % SIDE == 0 && column < columns;
    [[unroll]] for (int m = 0; m < 5; ++m) {
        const float sum = share * over_cell(inside ? sums[m] : 0);
        if (mine) {
            planes[target + m * step] = sum;
        }
    }
}
