#version 460
// refine_state.comp without the counts for drivers that run on a CPU: by load_lanes(), and PV vectors a
// workgroup.
//
// Layouts: as there; frames_address points at (0, 0) of a frame with a halo, state_origin at its plane 0.
// Bindings: 0 state; frames by address.
// Preconditions: frames readable (any content) up to PV LX pixels past their last row; gl_WorkGroupID below
//   4096 in each direction. Workgroup: PV LX pixels of one row of one frame.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int PV = 10;

layout(set = 0, binding = 0, std430) writeonly buffer State { float state[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t frames_address;
    uint frames_row; // elements
    uint frames_plane;
    uint state_origin;
    uint state_row;
    uint state_plane;
    uint width;
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

void main() {
    const uint x = uniform_id(gl_WorkGroupID.x) * (PV * LX);
    const uint y = uniform_id(gl_WorkGroupID.y);
    const uint z = uniform_id(gl_WorkGroupID.z);
    const uint64_t left = frames_address - 4ul;
    const uint64_t above = frames_address - uint64_t(min(y, 1) * frames_row) * 4ul;
    [[unroll]] for (int p = 0; p < PV; ++p) {
        const uint column = x + p * LX;
        const uint mine = column + gl_SubgroupInvocationID;
        const uint at = z * frames_plane + y * frames_row + column;
        const float value = load_lanes(frames_address, at, 1);
        const float across = load_lanes(left, at, 1) - value;
        const float down = load_lanes(above, at, 1) - value;
        const uint to = state_origin + 6 * z * state_plane + y * state_row + mine;
        if (mine < width) {
            state[to] = value;
            state[to + state_plane] = mine == 0 ? 0.0 : across;
            state[to + 2 * state_plane] = down;
        }
    }
}
