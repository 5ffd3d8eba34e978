#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "tensor.glsl"
#include "bilinear.glsl"
#include "fusion_constants.glsl"

// The anchors' frames fetched along the trajectories, as channels of the head's input:
//     planes(2 + rank(a), p) = anchors(a, p + up(away)(a, p)) - planes(0, p),  a = 0 ... 8
// up is bilinear to 8 times the size, samples at pixel centres, border values repeated. A frame
// between its pixels is bilinear; where it would be more than half a pixel beyond the border of the
// image the plane is 0. rank orders the anchors by their distance from the wanted time.
//
// anchors    9 channels, any layout of block 1
// away       finite, [9][cell_height][cell_width] vec2 (trajectory.comp), origin in vec2; a cell is 8 x 8 pixels
// instant    layers/instant.hpp: the ranks
// planes     16 channels, any layout; channel 0 is the prior (prior_frame.comp)
// Bindings: 0 anchors, 1 away, 2 instant, 3 planes.
// Precondition: width <= 4 x 64 x groups.x, ceil(height / 4) = groups.y.
// Tile: 4 x 4 pixels an invocation, between the centres of the same four cells; 64 x 1 invocations a
// workgroup.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Anchors { float anchors[]; };
layout(std430, binding = 1) readonly buffer Away { vec2 away[]; };
layout(std430, binding = 2) readonly buffer Instant { uint instant[]; };
layout(std430, binding = 3) buffer Planes { float planes[]; };

layout(push_constant) uniform Push {
    TensorLayout anchors_layout;
    TensorLayout planes_layout;
    uint away_origin;
    uint instant_origin;
    uint width;
    uint height;
    uint cell_width;
    uint cell_height;
};

const uint SIDE = 4; // pixels of a tile

void main() {
    const uint left = SIDE * gl_GlobalInvocationID.x;
    const uint top = SIDE * gl_WorkGroupID.y;
    if (left >= width) {
        return;
    }
    // The cells around, those outside replaced by the border's.
    const uvec2 after = (uvec2(gl_GlobalInvocationID.x, gl_WorkGroupID.y) + 1) / 2;
    const uvec2 limit = uvec2(cell_width, cell_height) - 1;
    const uvec2 low_cell = max(after, 1) - 1;
    const uvec2 high_cell = min(after, limit);
    const uint y0 = low_cell.y * cell_width;
    const uint y1 = high_cell.y * cell_width;
    // Centre of the first of them, were it not replaced.
    const vec2 centre = float(CELL) * (vec2(after) - 0.5) - 0.5;

    const vec2 last = vec2(width - 1, height - 1);
    const uint plane = cell_width * cell_height;
    float prior[SIDE * SIDE];
    [[unroll]] for (uint i = 0; i < SIDE * SIDE; ++i) {
        const uint x = min(left + i % SIDE, width - 1);
        const uint y = min(top + i / SIDE, height - 1);
        prior[i] = planes[element(planes_layout, PLANE_PRIOR, y, x)];
    }
    for (uint anchor = 0; anchor < ANCHORS; ++anchor) {
        const uint cells = away_origin + anchor * plane;
        const vec2 a = away[cells + y0 + low_cell.x];
        const vec2 b = away[cells + y0 + high_cell.x];
        const vec2 c = away[cells + y1 + low_cell.x];
        const vec2 d = away[cells + y1 + high_cell.x];
        const uint frame = anchors_layout.origin + anchor * anchors_layout.plane;
        const uint target = PLANE_DIFFERENCES + instant[instant_origin + INSTANT_RANKS + anchor];
        [[unroll]] for (uint i = 0; i < SIDE * SIDE; ++i) {
            // At the border some pixels twice: cheaper than branches.
            const uint x = min(left + i % SIDE, width - 1);
            const uint y = min(top + i / SIDE, height - 1);
            const vec2 pixel = vec2(x, y);
            const vec2 share = (pixel - centre) / float(CELL);
            const vec2 position = pixel + mix(mix(a, b, share.x), mix(c, d, share.x), share.y);
            const Neighbours n = neighbours(position, last);
            const uint upper = frame + n.at.y * anchors_layout.row;
            const uint lower = frame + n.next.y * anchors_layout.row;
            const float fetched =
                mix(mix(anchors[upper + n.at.x], anchors[upper + n.next.x], n.share.x),
                    mix(anchors[lower + n.at.x], anchors[lower + n.next.x], n.share.x), n.share.y);
            planes[element(planes_layout, target, y, x)] =
                is_inside(position, last) ? fetched - prior[i] : 0;
        }
    }
}
