#version 450
// Whether the refinement goes on after an iteration whose largest change of a pixel was `largest`:
//     moving = largest >= least ? 1 : 0      (0 where `largest` is not a number)
// Bindings: 0 largest, 1 moving, a word each. Workgroup: all of it.
layout(local_size_x = 1) in;

layout(std430, binding = 0) readonly buffer Largest { float largest[]; };
layout(std430, binding = 1) writeonly buffer Moving { float moving[]; };

layout(push_constant) uniform Push {
    uint largest_origin;
    uint moving_origin;
    float least;
};

void main() { moving[moving_origin] = largest[largest_origin] >= least ? 1.0 : 0.0; }
