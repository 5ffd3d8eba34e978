#version 450
// Whether the refinement goes on after an iteration whose largest change of a pixel was `largest`, and that
// of the iteration before `before`:
//     moving = largest >= least and (largest < before or not falling) ? 1 : 0
// 0 where `largest` is not a number.
// Bindings: 0 largest, 1 before, 2 moving, a word each. Workgroup: all of it.
layout(local_size_x = 1) in;

layout(std430, binding = 0) readonly buffer Largest { float largest[]; };
layout(std430, binding = 1) readonly buffer Before { float before[]; };
layout(std430, binding = 2) writeonly buffer Moving { float moving[]; };

layout(push_constant) uniform Push {
    uint largest_origin;
    uint before_origin;
    uint moving_origin;
    float least;
    uint falling;
};

void main() {
    const float change = largest[largest_origin];
    const bool falls = falling == 0 || change < before[before_origin];
    moving[moving_origin] = change >= least && falls ? 1.0 : 0.0;
}
