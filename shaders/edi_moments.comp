#version 450
#extension GL_GOOGLE_include_directive : require

// How well the event thresholds fit, by tile and time window. With N+ and N- the smoothed events of
// either sign, l the smoothed level of ln(L + e) at the exposure's start and b the smoothed ln(B + e):
// for window k, with the brightness change D = c+ (N+ in the window) - c- (N- in it), the gradient
// G = grad l + c+ grad N+ - c- grad N- in the middle of the window and one motion v a tile,
//     v = -(sum G G^T + RIDGE c+ c- I)^-1 sum G D    (least squares on D + v . G = 0)
// and the share r of sum D^2 that it explains (0 to 1), the sums over the tile's samples are
//     moments(0) = r sum (v . grad b) (D + v . G)      the blurry frame in the rest
//     moments(1) = r sum (v . grad b)^2
//     moments(2) = r sum (D + v . G)                   drift
//     moments(3) = r sum |D|
//     moments(4) = r sum (v . grad S) (D + v . G)      the exposure's change S in the rest
//     moments(5) = r sum (v . grad S)^2
//     moments(6) = r sum (v . grad b) (v . grad S)
// with S from the middle of the first window to that of the last.
//
// fields      [6 WINDOWS + 2][height][width]: in window 0, 1, ... N+; N-; the x derivatives of N+ in
//             the middle of each, of N-, of b; the y derivatives likewise
// level       [2][height][width]: grad l
// thresholds  [2]: c+, c-
// moments     [7][WINDOWS][tiles]
// Bindings: as listed.
// Precondition: tiles <= 64 x groups.x, WINDOWS = groups.y.
// Tile: SAMPLES x SAMPLES samples; one tile of a window an invocation, in a fixed order.
layout(local_size_x = 64) in;
layout(constant_id = 0) const float RIDGE = 0.05;

layout(std430, binding = 0) readonly buffer Fields { float fields[]; };
layout(std430, binding = 1) readonly buffer Level { float level[]; };
layout(std430, binding = 2) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 3) writeonly buffer Moments { float moments[]; };

layout(push_constant) uniform Push {
    uint fields_origin;
    uint level_origin;
    uint moments_origin;
    uint width;  // in samples
    uint height; // in samples
    uint tile_columns;
    uint tiles;
};

#include "edi_sampling.glsl"

void main() {
    const uint tile = gl_GlobalInvocationID.x;
    const uint window = gl_WorkGroupID.y;
    if (tile >= tiles) {
        return;
    }
    const uint left = tile % tile_columns * SAMPLES;
    const uint top = tile / tile_columns * SAMPLES;
    const uint right = min(left + SAMPLES, width);
    const uint bottom = min(top + SAMPLES, height);
    const uint plane = width * height;
    const uint group = WINDOWS * plane;
    const uint changes = fields_origin + window * plane;
    const uint x_slopes = changes + 2 * group;
    const uint y_slopes = x_slopes + 2 * group + plane;
    const uint still_x = fields_origin + 4 * group;
    const uint still_y = still_x + 2 * group + plane;
    const uint first_x = fields_origin + 2 * group;
    const uint first_y = first_x + 2 * group + plane;
    const uint last_x = first_x + group - plane;
    const uint last_y = first_y + group - plane;
    const float up = thresholds[0];
    const float down = thresholds[1];

    vec3 gg = vec3(0); // sums of Gx Gx, Gx Gy, Gy Gy
    vec2 gd = vec2(0); // G D
    vec3 bb = vec3(0); // grad b likewise
    vec2 bd = vec2(0);
    vec3 bg = vec3(0); // bx Gx, bx Gy + by Gx, by Gy
    vec3 ss = vec3(0); // grad S likewise
    vec2 sd = vec2(0);
    vec3 sg = vec3(0);
    vec3 sb = vec3(0);
    vec2 g = vec2(0);
    float d = 0;
    float dd = 0;
    float size = 0;
    for (uint y = top; y < bottom; ++y) {
        for (uint x = left; x < right; ++x) {
            const uint at = y * width + x;
            const vec2 slope =
                vec2(level[level_origin + at], level[level_origin + plane + at]) +
                up * vec2(fields[x_slopes + at], fields[y_slopes + at]) -
                down * vec2(fields[x_slopes + group + at], fields[y_slopes + group + at]);
            const vec2 still = vec2(fields[still_x + at], fields[still_y + at]);
            const float change = up * fields[changes + at] - down * fields[changes + group + at];
            gg += vec3(slope.x * slope.x, slope.x * slope.y, slope.y * slope.y);
            gd += slope * change;
            bb += vec3(still.x * still.x, still.x * still.y, still.y * still.y);
            bd += still * change;
            bg += vec3(still.x * slope.x, still.x * slope.y + still.y * slope.x,
                       still.y * slope.y);
            const vec2 whole =
                up * vec2(fields[last_x + at] - fields[first_x + at],
                          fields[last_y + at] - fields[first_y + at]) -
                down * vec2(fields[last_x + group + at] - fields[first_x + group + at],
                            fields[last_y + group + at] - fields[first_y + group + at]);
            ss += vec3(whole.x * whole.x, whole.x * whole.y, whole.y * whole.y);
            sd += whole * change;
            sg += vec3(whole.x * slope.x, whole.x * slope.y + whole.y * slope.x,
                       whole.y * slope.y);
            sb += vec3(whole.x * still.x, whole.x * still.y + whole.y * still.x,
                       whole.y * still.y);
            g += slope;
            d += change;
            dd += change * change;
            size += abs(change);
        }
    }
    const float ridge = RIDGE * up * down;
    gg.x += ridge;
    gg.z += ridge;
    const vec2 v = -vec2(gg.z * gd.x - gg.y * gd.y, gg.x * gd.y - gg.y * gd.x) /
                   (gg.x * gg.z - gg.y * gg.y);
    const float r = dd > 0 ? clamp(-dot(v, gd) / dd, 0.0, 1.0) : 0.0;
    const vec3 vv = vec3(v.x * v.x, v.x * v.y, v.y * v.y);

    const uint at = moments_origin + window * tiles + tile;
    const uint step = WINDOWS * tiles;
    moments[at] = r * (dot(v, bd) + dot(vv, bg));
    moments[at + step] = r * (vv.x * bb.x + 2 * vv.y * bb.y + vv.z * bb.z);
    moments[at + 2 * step] = r * (d + dot(v, g));
    moments[at + 3 * step] = r * size;
    moments[at + 4 * step] = r * (dot(v, sd) + dot(vv, sg));
    moments[at + 5 * step] = r * (vv.x * ss.x + 2 * vv.y * ss.y + vv.z * ss.z);
    moments[at + 6 * step] = r * dot(vv, sb);
}
