#version 450
#extension GL_EXT_control_flow_attributes : require

// What the frames of an exposure agree on (layers/agreement.hpp): with the differences d_i of others, fetched
// along the motion, to a frame,
//     to = frame + sum_i w_i d_i / (1 + sum_i w_i),   w_i = exp(-mean of d_i^2 over 3x3 pixels / tolerance^2)
// the border's pixels repeated. Where the motion misleads, or something is hidden, frames differ and w_i is 0.
//
// differences  [COUNT][height][width]
// frame, to    1 channel, block 1, any halo and pitch
// Bindings: 0 differences, 1 frame, 2 to.
// Precondition: width <= 64 x groups.x, ceil(height / ROWS) = groups.y.
// Tile: ROWS pixels of a column an invocation, 64 x 1 a workgroup; sums of three columns serve three rows.
layout(local_size_x = 64) in;
layout(constant_id = 0) const int COUNT = 3;

layout(std430, binding = 0) readonly buffer Differences { float differences[]; };
layout(std430, binding = 1) readonly buffer Frame { float frame[]; };
layout(std430, binding = 2) writeonly buffer To { float to[]; };

layout(push_constant) uniform Push {
    uint differences_origin;
    uint frame_origin;
    uint frame_row;
    uint to_origin;
    uint to_row;
    uint width;
    uint height;
    float scale; // 1 / (9 tolerance^2)
};

const int ROWS = 4;

void main() {
    const uint column = gl_GlobalInvocationID.x;
    const uint top = gl_WorkGroupID.y * ROWS;
    const uint x = min(column, width - 1);
    const uint left = max(x, 1) - 1;
    const uint right = min(x + 1, width - 1);
    float weights[ROWS], sums[ROWS];
    [[unroll]] for (int r = 0; r < ROWS; ++r) {
        weights[r] = 1;
        sums[r] = 0;
    }
    [[unroll]] for (int i = 0; i < COUNT; ++i) {
        const uint plane = differences_origin + i * width * height;
        float middle[ROWS + 2], squares[ROWS + 2];
        [[unroll]] for (int r = 0; r < ROWS + 2; ++r) {
            const uint line = plane + min(max(top + r, 1) - 1, height - 1) * width;
            const float before = differences[line + left];
            const float after = differences[line + right];
            middle[r] = differences[line + x];
            squares[r] = before * before + middle[r] * middle[r] + after * after;
        }
        [[unroll]] for (int r = 0; r < ROWS; ++r) {
            const float weight = exp(-scale * (squares[r] + squares[r + 1] + squares[r + 2]));
            weights[r] += weight;
            sums[r] += weight * middle[r + 1];
        }
    }
    [[unroll]] for (int r = 0; r < ROWS; ++r) {
        if (column < width && top + r < height) {
            const uint y = top + r;
            to[to_origin + y * to_row + x] = frame[frame_origin + y * frame_row + x] + sums[r] / weights[r];
        }
    }
}
