#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "tensor.glsl"
#include "bilinear.glsl"
#include "fusion_constants.glsl"

// Frames at every STEP-th anchor fetched along the trajectories, as differences to the frame at the wanted time:
//     planes(first + place(i), p) = frames(i, p + up(away)(i STEP, p)) - base(p),  i = 0 ... FRAMES - 1
// place(i) is the rank of the anchor by its distance from the wanted time where RANKED, else i. up is bilinear
// to 8 times the size, samples at pixel centres, border values repeated. A frame
// between its pixels is bilinear; where it would be more than half a pixel beyond the border of the
// image the plane is 0.
//
// frames     FRAMES channels, any layout of block 1
// away       finite, [9][cell_height][cell_width] vec2 (trajectory.comp), origin in vec2; a cell is 8 x 8 pixels
// instant    layers/instant.hpp: the ranks
// base       1 channel, any layout; may be another channel of planes
// planes     any layout
// Bindings: 0 frames, 1 away, 2 instant, 3 base, 4 planes.
// Precondition: width <= 64 x groups.x, ceil(height / ROWS) = groups.y, FRAMES = groups.z.
// Tile: ROWS pixels of a column an invocation, between the centres of the same four cells, and 64 x 1 invocations
// a workgroup, so that neighbours store, and mostly load, neighbours.
layout(local_size_x = 64) in;
layout(constant_id = 0) const int FRAMES = 9;
layout(constant_id = 1) const int STEP = 1;
layout(constant_id = 2) const int RANKED = 1;

layout(std430, binding = 0) readonly buffer Frames { float frames[]; };
layout(std430, binding = 1) readonly buffer Away { vec2 away[]; };
layout(std430, binding = 2) readonly buffer Instant { uint instant[]; };
layout(std430, binding = 3) readonly buffer Base { float base[]; };
layout(std430, binding = 4) writeonly buffer Planes { float planes[]; };

layout(push_constant) uniform Push {
    TensorLayout frames_layout;
    TensorLayout base_layout;
    TensorLayout planes_layout;
    uint away_origin;
    uint instant_origin;
    uint first;
    uint width;
    uint height;
    uint cell_width;
    uint cell_height;
};

const uint ROWS = 4; // pixels of a tile: half a cell

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint top = ROWS * gl_WorkGroupID.y;
    const uint f = gl_WorkGroupID.z;
    if (x >= width) {
        return;
    }
    // The cells around, those outside replaced by the border's.
    const uvec2 after = (uvec2(x / ROWS, gl_WorkGroupID.y) + 1) / 2;
    const uvec2 low_cell = max(after, 1) - 1;
    const uvec2 high_cell = min(after, uvec2(cell_width, cell_height) - 1);
    const uint cells = away_origin + f * STEP * (cell_width * cell_height);
    const uint y0 = cells + low_cell.y * cell_width;
    const uint y1 = cells + high_cell.y * cell_width;
    // Centre of the first of them, were it not replaced.
    const vec2 centre = float(CELL) * (vec2(after) - 0.5) - 0.5;
    const float share_x = (float(x) - centre.x) / float(CELL);
    const vec2 above = mix(away[y0 + low_cell.x], away[y0 + high_cell.x], share_x);
    const vec2 below = mix(away[y1 + low_cell.x], away[y1 + high_cell.x], share_x);

    const vec2 last = vec2(width - 1, height - 1);
    const uint frame = frames_layout.origin + f * frames_layout.plane;
    const uint target = first + (RANKED != 0 ? instant[instant_origin + INSTANT_RANKS + f] : f);
    [[unroll]] for (uint r = 0; r < ROWS; ++r) {
        const uint y = min(top + r, height - 1); // at the border a pixel twice: cheaper than branches
        const float share_y = (float(y) - centre.y) / float(CELL);
        const vec2 position = vec2(x, y) + mix(above, below, share_y);
        const Neighbours n = neighbours(position, last);
        const uint upper = frame + n.at.y * frames_layout.row;
        const uint lower = frame + n.next.y * frames_layout.row;
        const float fetched =
            mix(mix(frames[upper + n.at.x], frames[upper + n.next.x], n.share.x),
                mix(frames[lower + n.at.x], frames[lower + n.next.x], n.share.x), n.share.y);
        const float own = base[element(base_layout, 0, y, x)];
        planes[element(planes_layout, target, y, x)] =
            is_inside(position, last) ? fetched - own : 0;
    }
}
