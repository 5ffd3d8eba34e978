#version 450
// The second half of a convolution with one output channel (layers/conv_plane.hpp):
//
//   out[y][x] = added[y][x] (when has_added)
//               + sum over ky, kx < K of taps[ky K + kx][y + ky - K/2][x + kx - K/2], zero outside the image
//
// Layouts: taps K^2 channels, added and out 1 channel, all any layout.
// Bindings: 0 taps, 1 added, 2 out. Workgroup: 64 pixels of one row.
#extension GL_GOOGLE_include_directive : require
#include "tensor.glsl"
layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) readonly buffer Taps { float taps[]; };
layout(set = 0, binding = 1, std430) readonly buffer Added { float added[]; };
layout(set = 0, binding = 2, std430) writeonly buffer Out { float out_[]; };
layout(push_constant) uniform Push {
    TensorLayout taps_layout;
    TensorLayout added_layout;
    TensorLayout out_layout;
    uint height;
    uint width;
    uint kernel;
    uint has_added;
};

void main() {
    const uint x = gl_GlobalInvocationID.x;
    const uint y = gl_GlobalInvocationID.y;
    if (x >= width) {
        return;
    }
    const int pad = int(kernel / 2u);
    float sum = has_added != 0u ? added[element(added_layout, 0u, y, x)] : 0.0;
    for (uint ky = 0u; ky < kernel; ++ky) {
        const uint row = uint(int(y + ky) - pad); // wraps above the image to more than height
        for (uint kx = 0u; kx < kernel; ++kx) {
            const uint column = uint(int(x + kx) - pad);
            if (row < height && column < width) {
                sum += taps[element(taps_layout, ky * kernel + kx, row, column)];
            }
        }
    }
    out_[element(out_layout, 0u, y, x)] = sum;
}
