#version 460
// shaders/fusion_fetch.comp for drivers that run on a CPU (lavapipe): frames at every STEP-th anchor fetched along
// the trajectories, as differences. The same sums in the same order.
//
// A load at addresses of the lanes' own costs the driver some 17 cycles, and a fetch takes four. But
// neighbours move alike: what 8 pixels of a row fetch lies mostly within 3 rows and 16 columns. So 8 x 4
// pixels get 6 rows of 16 columns by vector loads (shaders/lane_load.glsl), from the first row and the first
// column that any of them wants, and each lane takes its own by shuffles. Whoever's lie elsewhere get them
// one at a time at the end. On Mesa 22.3.6 at 240x180 on one core a frame takes 1.5 ms where fusion_fetch.comp
// takes 3.2; 2.0 ms where displacements change by 4 pixels from a cell to the next.
// The driver loads once for all lanes only where the first lane is certain to be active: neither behind a
// branch (a ?: of two function calls is one) nor after a loop, even one that has ended. Hence one loop for
// what is left of all frames, as the last thing; its body, run once at least, would cost 220 cycles for
// each frame. A workgroup costs 350 to start, hence all frames in one.
//
// Layouts: frames_address at (0, 0) of channel 0, base_address of the base, planes_origin of the first
//   difference's channel, all block 1; away and instant as in fusion_fetch.comp.
// Bindings: 0 planes; everything else by address.
// Preconditions: frames and base readable (any content) up to 16 elements past their last row;
//   gl_WorkGroupID below 4096. Workgroup: 8 x 4 pixels, half of them between the same four cells.
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_shuffle : require
#include "fusion_constants.glsl"

const int LX = 8; // as many as a cell has columns
layout(local_size_x = LX) in;
layout(constant_id = 0) const int FRAMES = 9; // 16 at the most
layout(constant_id = 1) const int STEP = 1;
layout(constant_id = 2) const int RANKED = 1;

layout(set = 0, binding = 0, std430) writeonly buffer Planes { float planes[]; };
layout(push_constant, scalar) uniform Push {
    uint64_t frames_address;
    uint64_t away_address;
    uint64_t base_address;
    uint64_t instant_address;
    uint frames_row; // elements
    uint frames_plane;
    uint base_row;
    uint planes_origin;
    uint planes_row;
    uint planes_plane;
    uint width;
    uint height;
    uint cell_width;
    uint cell_height;
    uint digit[8]; // 0, 1, ..., 7
};

#include "lane_load.glsl"
#include "uniform_id.glsl"
#include "bilinear.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 4) readonly buffer Words { uint v[]; };

const int SIDE = 4; // rows of a workgroup
const int NOWHERE = 1 << 20;

int smallest(int value) {
    value = min(value, subgroupShuffleXor(value, 1));
    value = min(value, subgroupShuffleXor(value, 2));
    return min(value, subgroupShuffleXor(value, 4));
}

vec2 cell(Source away, uint index) {
    return vec2(away.v[2 * index], away.v[2 * index + 1]);
}

// The lanes' columns of 16.
float pick(float low, float high, uint column) {
    const float left = subgroupShuffle(low, column & 7);
    const float right = subgroupShuffle(high, column & 7);
    return column < LX ? left : right;
}

void main() {
    const uint lane = gl_SubgroupInvocationID;
    const uint column = uniform_id(gl_WorkGroupID.x); // of cells
    const uint half_row = uniform_id(gl_WorkGroupID.y);
    const uint left = column * LX;
    const uint top = half_row * SIDE;
    const vec2 last = vec2(width - 1, height - 1);
    const bool right_half = lane >= LX / 2;
    Source away = Source(away_address);

    // The cells around, those outside replaced by the border's, and the centre of the first of them, were it
    // not replaced.
    const uint after_y = (half_row + 1) / 2;
    const uint y0 = (max(after_y, 1) - 1) * cell_width;
    const uint y1 = min(after_y, cell_height - 1) * cell_width;
    const uint before = max(column, 1) - 1;
    const uint next = min(column + 1, cell_width - 1);
    const float centre_x = float(CELL) * (float(column + (right_half ? 1 : 0)) - 0.5) - 0.5;
    const float centre_y = float(CELL) * (float(after_y) - 0.5) - 0.5;

    const uint x = min(left + lane, width - 1);
    const float share_x = (float(x) - centre_x) / float(CELL);
    float y[SIDE], share_y[SIDE], own[SIDE];
    [[unroll]] for (int r = 0; r < SIDE; ++r) {
        y[r] = float(min(top + r, height - 1));
        share_y[r] = (y[r] - centre_y) / float(CELL);
        own[r] = load_row(base_address + uint64_t(min(top + r, height - 1) * base_row + left) * 4ul);
    }
    // Push constants for what is behind branches, where the driver reads them lane by lane.
    const uint frame_row = frames_row;
    const uint frame_plane = frames_plane;
    const uint64_t frames = frames_address;
    const uint target_row = planes_row;
    const uint below = left + lane < width ? height : 0;
    const uint target = planes_origin + top * planes_row + left + lane;

    vec2 above[FRAMES], beneath[FRAMES]; // displacements between the upper and between the lower cells
    uint plane[FRAMES];
    uint waits[2] = {0, 0}; // bits of SIDE rows a frame
    [[unroll]] for (int f = 0; f < FRAMES; ++f) {
        const uint cells = f * STEP * (cell_width * cell_height);
        vec2 upper[3], lower[3];
        [[unroll]] for (int i = 0; i < 3; ++i) {
            const uint there = i == 0 ? before : (i == 1 ? column : next);
            upper[i] = cell(away, cells + y0 + there);
            lower[i] = cell(away, cells + y1 + there);
        }
        above[f] = mix(right_half ? upper[1] : upper[0], right_half ? upper[2] : upper[1], share_x);
        beneath[f] = mix(right_half ? lower[1] : lower[0], right_half ? lower[2] : lower[1], share_x);
        const uint rank = Words(instant_address).v[INSTANT_RANKS + f];
        plane[f] = target + (RANKED != 0 ? rank : f) * planes_plane;

        Neighbours n[SIDE];
        bool inside[SIDE];
        int wanted_y = NOWHERE;
        int wanted_x = NOWHERE;
        [[unroll]] for (int r = 0; r < SIDE; ++r) {
            const vec2 position = vec2(x, y[r]) + mix(above[f], beneath[f], share_y[r]);
            n[r] = neighbours(position, last);
            inside[r] = is_inside(position, last);
            wanted_y = min(wanted_y, int(n[r].at.y) - r);
            wanted_x = min(wanted_x, int(n[r].at.x));
        }
        const int first_y = smallest(wanted_y);
        const int first_x = smallest(wanted_x);
        // From a row above the image on, perhaps, as all lie lower there.
        const uint from_y = uniform_id(uint(first_y + SIDE));
        const uint from_x = uniform_id(uint(first_x));
        float low[SIDE + 2], high[SIDE + 2];
        [[unroll]] for (int r = 0; r < SIDE + 2; ++r) {
            const uint row = min(max(from_y + r, SIDE) - SIDE, height - 1);
            const uint64_t address =
                frames_address + uint64_t(f * frames_plane + row * frames_row + from_x) * 4ul;
            low[r] = load_row(address);
            high[r] = load_row(address + uint64_t(LX) * 4ul);
        }
        [[unroll]] for (int r = 0; r < SIDE; ++r) {
            const uint down = n[r].at.y - uint(first_y + r);
            const uint at = n[r].at.x - uint(first_x);
            const uint beyond = n[r].next.x - uint(first_x);
            const bool second = down == 1;
            float rows[3];
            [[unroll]] for (int i = 0; i < 3; ++i) {
                rows[i] = mix(pick(low[r + i], high[r + i], at),
                              pick(low[r + i], high[r + i], beyond), n[r].share.x);
            }
            const float fetched =
                mix(second ? rows[1] : rows[0], second ? rows[2] : rows[1], n[r].share.y);
            const int bit = f * SIDE + r;
            waits[bit / 32] |= (down > 1 || beyond >= 2 * LX) && inside[r] ? 1u << (bit % 32) : 0;
            const float difference = inside[r] ? fetched - own[r] : 0;
            if (top + r < below) {
                planes[plane[f] + r * target_row] = difference;
            }
        }
    }
    // One pixel at a time of those that each lane still wants. After a loop too the driver reads lane by lane.
    while ((waits[0] | waits[1]) != 0) {
        const uint bit = waits[0] != 0 ? findLSB(waits[0]) : 32 + findLSB(waits[1]);
        waits[1] &= waits[0] != 0 ? ~0u : waits[1] - 1;
        waits[0] &= waits[0] - 1; // of 0: 0
        const uint frame = bit / SIDE;
        const uint row = bit % SIDE;
        vec2 upper = above[0];
        vec2 lower = beneath[0];
        uint place = plane[0];
        [[unroll]] for (int f = 1; f < FRAMES; ++f) {
            upper = f == frame ? above[f] : upper;
            lower = f == frame ? beneath[f] : lower;
            place = f == frame ? plane[f] : place;
        }
        float own_share = share_y[0];
        float own_y = y[0];
        float own_base = own[0];
        [[unroll]] for (int r = 1; r < SIDE; ++r) {
            own_share = r == row ? share_y[r] : own_share;
            own_y = r == row ? y[r] : own_y;
            own_base = r == row ? own[r] : own_base;
        }
        const Neighbours n = neighbours(vec2(x, own_y) + mix(upper, lower, own_share), last);
        Source source = Source(frames);
        const uint first = frame * frame_plane + n.at.y * frame_row;
        const uint second = frame * frame_plane + n.next.y * frame_row;
        const float fetched =
            mix(mix(source.v[first + n.at.x], source.v[first + n.next.x], n.share.x),
                mix(source.v[second + n.at.x], source.v[second + n.next.x], n.share.x), n.share.y);
        if (top + row < below) {
            planes[place + row * target_row] = fetched - own_base;
        }
    }
}
