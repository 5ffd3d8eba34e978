#version 450
// x = a x + b over and over: the float32 operations a second that a kernel can do (runtime/roof.cpp).
//
//   sum[i] = sum over c < CHAINS of x_c after 32 `rounds` such steps, from x_c = (i mod 64 + c) / 64
//
// The chains are independent, so that each hides the others' latency, and all stay in registers; 32 steps are
// unrolled, so that the loop itself costs little. a and b come from the push constants and every x goes into
// the output, so no compiler can leave a step out.
// sum  [64 x groups.x]. Bindings: 0 sum. Workgroup: 64 elements.
#extension GL_EXT_control_flow_attributes : require
layout(local_size_x = 64) in;
layout(constant_id = 0) const int CHAINS = 8;
layout(set = 0, binding = 0, std430) writeonly buffer Sum { float sum[]; };
layout(push_constant) uniform Push {
    float a;
    float b;
    uint rounds;
};

void main() {
    const int kSteps = 32;
    float x[CHAINS];
    [[unroll]] for (int c = 0; c < CHAINS; ++c) {
        x[c] = float(gl_LocalInvocationID.x + c) / 64.0;
    }
    for (uint round = 0u; round < rounds; ++round) {
        [[unroll]] for (int step = 0; step < kSteps; ++step) {
            [[unroll]] for (int c = 0; c < CHAINS; ++c) {
                x[c] = x[c] * a + b;
            }
        }
    }
    float total = 0.0;
    [[unroll]] for (int c = 0; c < CHAINS; ++c) {
        total += x[c];
    }
    sum[gl_GlobalInvocationID.x] = total;
}
