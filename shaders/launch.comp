#version 450
// Workgroup counts of dispatches that run only where a flag is set (Program::when in runtime/program.hpp):
//     counts[i] = flag != 0 ? wanted[i] : 0
// where the three counts of a dispatch follow each other.
//
// flag       a word of any type
// counts     [words]
// Bindings: 0 flag, 1 counts.
// Precondition: words <= 24. Workgroup: all of it, one word an invocation.
layout(local_size_x = 24) in;

layout(std430, binding = 0) readonly buffer Flag { uint flag[]; };
layout(std430, binding = 1) writeonly buffer Counts { uint counts[]; };

layout(push_constant) uniform Push {
    uint flag_origin;
    uint words;
    uint wanted[24];
};

void main() {
    const uint i = gl_LocalInvocationIndex;
    if (i < words) {
        counts[i] = flag[flag_origin] != 0 ? wanted[i] : 0;
    }
}
