// The equations D + d . G = 0 of a neighbourhood's pixels for one displacement d, by least squares
// (tools/train/motion.py): their moments, and the d that minimises sum (D + d . G)^2 + ridge |d|^2.
// Where all gradients have one direction, d along the stripes is wrong by about eps |G|^2 / ridge of
// |d|: the rounding of the moments themselves (eps = 2^-24), which no better solution mends.

const uint SIDE = 4; // samples a side of a cell, at half the resolution

struct Moments {
    vec3 gg; // Gx Gx, Gx Gy, Gy Gy
    vec2 gd; // Gx D, Gy D
};

void add_equation(inout Moments moments, vec2 g, float d, float weight) {
    moments.gg += weight * vec3(g.x * g.x, g.x * g.y, g.y * g.y);
    moments.gd += weight * d * g;
}

vec2 solve(Moments moments, float ridge) {
    const float a = moments.gg.x + ridge;
    const float c = moments.gg.z + ridge;
    // a c - b b, but what the ridge adds does not pass through the difference.
    const float determinant = (moments.gg.x * moments.gg.z - moments.gg.y * moments.gg.y) +
                              ridge * (moments.gg.x + c);
    return -vec2(c * moments.gd.x - moments.gg.y * moments.gd.y,
                 a * moments.gd.y - moments.gg.y * moments.gd.x) /
           determinant;
}
