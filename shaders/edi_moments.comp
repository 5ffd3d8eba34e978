#version 450

// How well the event thresholds fit, by tile and time window. X_0 ... X_count are smoothed frames of
// ln(L + e) at ascending times and b is the smoothed ln(B + e). For window k, with the brightness
// change D = X_{k+1} - X_k, the gradient G = (grad X_k + grad X_{k+1}) / 2 and one motion v a tile,
//     v = -(sum G G^T + RIDGE c+ c- I)^-1 sum G D    (least squares on D + v . G = 0)
// and the share r of sum D^2 that it explains (0 to 1), the sums over the tile's pixels are
//     moments(0) = r sum (v . grad b) (D + v . G)      the blurry frame in the rest
//     moments(1) = r sum (v . grad b)^2
//     moments(2) = r sum (D + v . G)                   drift
//     moments(3) = r sum |D|
// Derivatives are central differences over five pixels; every second pixel in x and y counts.
//
// frames      [windows + 2][height][width]: X_0 ... X_windows, b
// thresholds  [2]: c+, c-
// moments     [4][windows][tiles]
// Precondition: width, height >= 5; tiles <= 64 x groups.x, windows = groups.y.
// Tile: 8 x 8 samples of 2 pixels' distance; one tile of a window an invocation, in a fixed order.
layout(local_size_x = 64) in;
layout(constant_id = 0) const float RIDGE = 0.05;

layout(std430, binding = 0) readonly buffer Frames { float frames[]; };
layout(std430, binding = 1) readonly buffer Thresholds { float thresholds[]; };
layout(std430, binding = 2) writeonly buffer Moments { float moments[]; };

layout(push_constant) uniform Push {
    uint frames_origin;
    uint moments_origin;
    uint width;
    uint height;
    uint windows;
    uint tile_columns;
    uint tiles;
};

const uint SAMPLES = 8;
const uint STEP = 2;
const uint MARGIN = 2; // reach of a derivative

vec2 gradient(uint at) {
    const vec2 near = vec2(frames[at + 1] - frames[at - 1], frames[at + width] - frames[at - width]);
    const vec2 far =
        vec2(frames[at + 2] - frames[at - 2], frames[at + 2 * width] - frames[at - 2 * width]);
    return (8 * near - far) / 12;
}

void main() {
    const uint tile = gl_GlobalInvocationID.x;
    const uint window = gl_WorkGroupID.y;
    if (tile >= tiles) {
        return;
    }
    const uint left = MARGIN + tile % tile_columns * (SAMPLES * STEP);
    const uint top = MARGIN + tile / tile_columns * (SAMPLES * STEP);
    const uint right = min(left + SAMPLES * STEP, width - MARGIN);
    const uint bottom = min(top + SAMPLES * STEP, height - MARGIN);
    const uint plane = width * height;
    const uint early = frames_origin + window * plane;
    const uint late = early + plane;
    const uint blurry = frames_origin + (windows + 1) * plane;

    vec3 gg = vec3(0); // sums of Gx Gx, Gx Gy, Gy Gy
    vec2 gd = vec2(0); // G D
    vec3 bb = vec3(0); // grad b likewise
    vec2 bd = vec2(0);
    vec3 bg = vec3(0); // bx Gx, bx Gy + by Gx, by Gy
    vec2 g = vec2(0);
    float d = 0;
    float dd = 0;
    float size = 0;
    for (uint y = top; y < bottom; y += STEP) {
        for (uint x = left; x < right; x += STEP) {
            const uint at = y * width + x;
            const vec2 slope = 0.5 * (gradient(early + at) + gradient(late + at));
            const vec2 still = gradient(blurry + at);
            const float change = frames[late + at] - frames[early + at];
            gg += vec3(slope.x * slope.x, slope.x * slope.y, slope.y * slope.y);
            gd += slope * change;
            bb += vec3(still.x * still.x, still.x * still.y, still.y * still.y);
            bd += still * change;
            bg += vec3(still.x * slope.x, still.x * slope.y + still.y * slope.x,
                       still.y * slope.y);
            g += slope;
            d += change;
            dd += change * change;
            size += abs(change);
        }
    }
    const float ridge = RIDGE * thresholds[0] * thresholds[1];
    gg.x += ridge;
    gg.z += ridge;
    const vec2 v = -vec2(gg.z * gd.x - gg.y * gd.y, gg.x * gd.y - gg.y * gd.x) /
                   (gg.x * gg.z - gg.y * gg.y);
    const float r = dd > 0 ? clamp(-dot(v, gd) / dd, 0.0, 1.0) : 0.0;
    const vec3 vv = vec3(v.x * v.x, v.x * v.y, v.y * v.y);

    const uint at = moments_origin + window * tiles + tile;
    const uint step = windows * tiles;
    moments[at] = r * (dot(v, bd) + dot(vv, bg));
    moments[at + step] = r * (vv.x * bb.x + 2 * vv.y * bb.y + vv.z * bb.z);
    moments[at + 2 * step] = r * (d + dot(v, g));
    moments[at + 3 * step] = r * size;
}
