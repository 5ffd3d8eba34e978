#version 460
// The end of two convolutions in one (shaders/conv_pair.comp), for drivers that run on a CPU (lavapipe):
//
//   out[y][x] = added[y][x] (ADDED = 1) + bias + sum over ky, kx < 3 of planes[3 ky + kx][y + ky - 1][x + kx - 1]
//
// With load_lanes() and PV vectors a workgroup it takes 0.25 ms at 240x180; the tap_sum.comp of the other
// devices, with its tests for the border, takes 1.9 ms there.
//
// Layouts: all block 1; planes_address and planes_origin point at (-1, -1) of plane 0, which has zeros
//   around the image, added_address at (0, 0).
// Bindings: 0 out; planes and added by address.
// Preconditions: planes and added readable (any content) up to PV LX pixels past their last row;
//   gl_WorkGroupID.x and .y below 4096. Workgroup: PV LX pixels of one row.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require

layout(local_size_x_id = 0) in;
layout(constant_id = 0) const int LX = 8;
layout(constant_id = 1) const int PV = 10;
layout(constant_id = 2) const int ADDED = 0;

layout(set = 0, binding = 0, std430) writeonly buffer Out { float out_[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t planes_address;
    uint64_t added_address;
    uint planes_origin; // elements
    uint planes_row;
    uint planes_plane;
    uint added_row;
    uint out_origin;
    uint out_row;
    uint width;
    float bias;
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"

void main() {
    const uint x = uniform_id(gl_WorkGroupID.x) * (PV * LX);
    const uint y = uniform_id(gl_WorkGroupID.y);
    [[unroll]] for (int p = 0; p < PV; ++p) {
        const uint column = x + p * LX;
        float sum = bias;
        if (ADDED != 0) {
            sum += load_lanes(added_address, y * added_row + column, 1);
        }
        [[unroll]] for (int k = 0; k < 9; ++k) {
            sum += load_lanes(planes_address,
                              planes_origin + k * planes_plane + (y + k / 3) * planes_row + column + k % 3, 1);
        }
        if (column + gl_SubgroupInvocationID < width) {
            out_[out_origin + y * out_row + column + gl_SubgroupInvocationID] = sum;
        }
    }
}
