#version 450
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require

// Moments of what motion remains between neighbouring anchors, one round of Gauss and Newton. With the
// displacement d over a gap, bilinear between the cells' centres, the earlier frame is fetched at
// p - d / 2 and the later one at p + d / 2:
//     D = X_late(p + d / 2) - X_early(p - d / 2)
//     G = (grad X_early(p - d / 2) + grad X_late(p + d / 2)) / 2
//     moments(m) = mean over a cell of (Gx Gx, Gx Gy, Gy Gy, Gx D, Gy D)(m)
// A cell is 4 x 4 samples of half the resolution; samples outside the image, and those fetched from
// more than half a sample beyond its border, count as 0.
//
// slopes      [9][height][width] vec4 (motion_slopes.comp)
// moved       [8][rows][columns] vec2: d in full pixels
// moments     [5][8][rows][columns]
// Bindings: 0 slopes, 1 moved, 2 moments. Origins in elements of the buffers.
// Precondition: columns <= 64 x groups.x, rows = groups.y, 8 = groups.z.
// Tile: one cell of one gap an invocation, summed in a fixed order.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Slopes { vec4 slopes[]; };
layout(std430, binding = 1) readonly buffer Moved { vec2 moved[]; };
layout(std430, binding = 2) writeonly buffer MomentPlanes { float planes[]; };

layout(push_constant) uniform Push {
    uint slopes_origin;
    uint moved_origin;
    uint moments_origin;
    uint width;
    uint height;
    uint columns;
    uint rows;
};

#include "bilinear.glsl"
#include "fusion_constants.glsl"
#include "motion_steps.glsl"

// X, Gx, Gy of the frame that starts at `frame`.
vec3 fetch(uint frame, vec2 position, vec2 last) {
    const Neighbours n = neighbours(position, last);
    const uint upper = frame + n.at.y * width;
    const uint lower = frame + n.next.y * width;
    return mix(mix(slopes[upper + n.at.x].xyz, slopes[upper + n.next.x].xyz, n.share.x),
               mix(slopes[lower + n.at.x].xyz, slopes[lower + n.next.x].xyz, n.share.x), n.share.y);
}

void main() {
    const uint column = gl_GlobalInvocationID.x;
    const uint row = gl_WorkGroupID.y;
    const uint gap = gl_WorkGroupID.z;
    if (column >= columns) {
        return;
    }
    // d of the 3 x 3 cells around, those outside replaced by the border's.
    const uint cells = moved_origin + gap * rows * columns;
    const uvec3 y = cells + columns * uvec3(max(row, 1) - 1, row, min(row + 1, rows - 1));
    const uvec3 x = uvec3(max(column, 1) - 1, column, min(column + 1, columns - 1));
    vec2 around[9];
    [[unroll]] for (uint i = 0; i < 9; ++i) {
        around[i] = moved[y[i / 3] + x[i % 3]];
    }
    const uint plane = width * height;
    const vec2 last = vec2(width - 1, height - 1);
    const uint early = slopes_origin + gap * plane;
    Moments moments = Moments(vec3(0), vec2(0));
    [[unroll]] for (uint i = 0; i < SIDE * SIDE; ++i) {
        const uvec2 within = uvec2(i % SIDE, i / SIDE);
        const uvec2 sample_ = SIDE * uvec2(column, row) + within;
        if (sample_.x < width && sample_.y < height) {
            // From the upper left of the 2 x 2 cells around the sample.
            const vec2 place = (vec2(within) + 0.5) / float(SIDE) + 0.5;
            const uvec2 cell = uvec2(place);
            const vec2 share = place - vec2(cell);
            const uint at = 3 * cell.y + cell.x;
            const vec2 d = mix(mix(around[at], around[at + 1], share.x),
                               mix(around[at + 3], around[at + 4], share.x), share.y);
            const vec2 from = vec2(sample_) - 0.25 * d; // half of d, in samples
            const vec2 to = vec2(sample_) + 0.25 * d;
            if (is_inside(from, last) && is_inside(to, last)) {
                const vec3 first = fetch(early, from, last);
                const vec3 second = fetch(early + plane, to, last);
                add_equation(moments, 0.5 * (first.yz + second.yz), second.x - first.x,
                             1.0 / float(SIDE * SIDE));
            }
        }
    }
    const uint step = GAPS * rows * columns;
    const uint at = moments_origin + (gap * rows + row) * columns + column;
    planes[at] = moments.gg.x;
    planes[at + step] = moments.gg.y;
    planes[at + 2 * step] = moments.gg.z;
    planes[at + 3 * step] = moments.gd.x;
    planes[at + 4 * step] = moments.gd.y;
}
