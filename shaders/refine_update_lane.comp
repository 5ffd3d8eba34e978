#version 460
// refine_update.comp (see there for the formulas) for drivers that run on a CPU: with load_lanes() 14 frames
// of 240x180 take 5 ms in place of 11 ms.
//
// Layouts: as there; the addresses point at (0, 0) of frame `first`, updated_origin into the binding.
// Bindings: 0 updated, 1 largest; everything else by address.
// Preconditions: what is read readable (any content) up to PV LX pixels past its last row; gl_WorkGroupID
//   below 4096 in each direction. Workgroup: PV LX pixels of one row of one frame.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int PV = 10;

layout(set = 0, binding = 0, std430) writeonly buffer Updated { float updated[]; };
layout(set = 0, binding = 1, std430) buffer Largest { uint largest[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t initial_address;
    uint64_t state_address;
    uint updated_origin;
    uint largest_origin;
    uint row;
    uint plane;
    uint width;
    uint first;
    uint last;
    float alpha[10];
    float largest_step;
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "refine_step.glsl"
#include "uniform_id.glsl"

void main() {
    const uint x = uniform_id(gl_WorkGroupID.x) * (PV * LX);
    const uint y = uniform_id(gl_WorkGroupID.y);
    const uint z = uniform_id(gl_WorkGroupID.z);
    // No branches: loads inside of them would go lane by lane.
    const uint before = min(first + z, 1);
    const uint after = min(last - first - z, 1);
    const uint64_t above = state_address - uint64_t(row + 1) * 4ul;
    const uint64_t previous = state_address - uint64_t(before * 6 * plane) * 4ul;
    float far = 0;
    [[unroll]] for (int p = 0; p < PV; ++p) {
        const uint column = x + p * LX;
        const uint pixel = y * row + column;
        const uint at = 6 * z * plane + pixel;
        float sum = alpha[9];
        [[unroll]] for (int k = 0; k < 9; ++k) {
            sum += alpha[k] * load_lanes(above, at + (k / 3) * row + k % 3, 1);
        }
        const uint residual = at + 5 * plane;
        const uint target = z * plane + pixel;
        const float value = load_lanes(state_address, at, 1);
        const float result = refine_step(
            sum, largest_step, value, load_lanes(initial_address, target, 1), before != 0,
            load_lanes(previous, at, 1), load_lanes(state_address, residual, 1), after != 0,
            load_lanes(state_address, at + after * 6 * plane, 1),
            load_lanes(state_address, residual + after * 6 * plane, 1));
        if (column + gl_SubgroupInvocationID < width) {
            updated[updated_origin + target + gl_SubgroupInvocationID] = result;
            far = max(far, abs(result - value));
        }
    }
    atomicMax(largest[largest_origin], floatBitsToUint(far));
}
