#version 450
#extension GL_GOOGLE_include_directive : require

// Moments of local motion (Lucas and Kanade) in the gaps between the fusion network's anchors. With the
// smoothed logarithms X_0 ... X_32 at even times, for window k the change D = X_{k+1} - X_k and the
// gradient G = (grad X_k + grad X_{k+1}) / 2 a full pixel, half of a sample of X:
//     moments(m, g) = mean over the 4 windows of gap g and over a cell of
//                     (Gx Gx, Gx Gy, Gy Gy, Gx D, Gy D)(m)
// A cell is 4 x 4 samples, those outside the image counting as 0. Derivatives are central differences,
// border samples repeated.
//
// frames      [33][height][width]: X
// moments     [5][8][rows][columns]
// Bindings: 0 frames, 1 moments.
// Precondition: columns <= 64 x groups.x, rows = groups.y, 8 = groups.z.
// Tile: one cell of one gap an invocation, summed in a fixed order.
layout(local_size_x = 64) in;

layout(std430, binding = 0) readonly buffer Frames { float frames[]; };
layout(std430, binding = 1) writeonly buffer MomentPlanes { float planes[]; };

layout(push_constant) uniform Push {
    uint frames_origin;
    uint moments_origin;
    uint width;
    uint height;
    uint columns;
    uint rows;
};

#include "fusion_constants.glsl"
#include "motion_steps.glsl"

void main() {
    const uint column = gl_GlobalInvocationID.x;
    const uint row = gl_WorkGroupID.y;
    const uint gap = gl_WorkGroupID.z;
    if (column >= columns) {
        return;
    }
    const uint plane = width * height;
    const uint right = min(SIDE * column + SIDE, width);
    const uint bottom = min(SIDE * row + SIDE, height);

    Moments moments = Moments(vec3(0), vec2(0));
    for (uint y = SIDE * row; y < bottom; ++y) {
        for (uint x = SIDE * column; x < right; ++x) {
            const uint at = y * width + x;
            const uint left_of = at - min(x, 1);
            const uint right_of = at + (x + 1 < width ? 1 : 0);
            const uint above = at - (y > 0 ? width : 0);
            const uint below = at + (y + 1 < height ? width : 0);
            uint frame = frames_origin + gap * WINDOWS_A_GAP * plane;
            float early = frames[frame + at];
            vec2 early_slope = vec2(frames[frame + right_of] - frames[frame + left_of],
                                    frames[frame + below] - frames[frame + above]);
            for (uint k = 0; k < WINDOWS_A_GAP; ++k) {
                frame += plane;
                const float late = frames[frame + at];
                const vec2 late_slope = vec2(frames[frame + right_of] - frames[frame + left_of],
                                             frames[frame + below] - frames[frame + above]);
                add_equation(moments, 0.125 * (early_slope + late_slope), late - early,
                             1.0 / float(WINDOWS_A_GAP));
                early = late;
                early_slope = late_slope;
            }
        }
    }
    const float share = 1.0 / float(SIDE * SIDE);
    const uint step = GAPS * rows * columns;
    const uint at = moments_origin + (gap * rows + row) * columns + column;
    planes[at] = share * moments.gg.x;
    planes[at + step] = share * moments.gg.y;
    planes[at + 2 * step] = share * moments.gg.z;
    planes[at + 3 * step] = share * moments.gd.x;
    planes[at + 4 * step] = share * moments.gd.y;
}
