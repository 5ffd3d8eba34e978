// Loads for lavapipe where a lane is a pixel: LX (specialization constant, the subgroup's size) neighbours
// of a row, one a lane. Its include needs GL_EXT_buffer_reference, GL_EXT_scalar_block_layout,
// GL_EXT_shader_explicit_arithmetic_types_int64, GL_EXT_control_flow_attributes and
// GL_KHR_shader_subgroup_basic.
//
// The driver loads source.v[lane] one lane at a time (about 17 cycles for 8 lanes). A load whose address is
// made of constants and push constants it does once for all lanes, and it knows the subgroup's invocation
// ids as constants; so LX such loads with selects by the id are, once LLVM has merged them, a single vector
// load, mostly a mere operand: the sum of 9 planes takes 0.23 ms instead of 0.69 ms (240x180).
// LLVM merges only if each vector has an address of its own: where neighbouring vectors share their loads
// it leaves broadcasts and blends. Hence the offset goes in as a 32-bit sum of elements, which it cannot
// take apart.
// Four floats a load rather than one: the same machine code from half the front end's and LLVM's time.
// volatile: the driver's front end else compares each load with all before it to find copies; without that it
// takes 0.28 instead of 1.3 to 1.9 s for conv_row's 3x3 S 2 of 32 channels, and the code is as fast.
layout(buffer_reference, scalar, buffer_reference_align = 4) volatile readonly buffer Source { float v[]; };
layout(buffer_reference, scalar, buffer_reference_align = 4) volatile readonly buffer Quads { vec4 v[]; };

// LX neighbours from `address`.
float load_row(uint64_t address) {
    Quads source = Quads(address);
    float value = source.v[0].x;
    [[unroll]] for (int k = 1; k < LX; ++k) {
        const float next = source.v[k / 4][k % 4];
        value = gl_SubgroupInvocationID == k ? next : value;
    }
    return value;
}

// Every `stride`-th float from element `at` of the memory at `address`, both uniform.
float load_lanes(uint64_t address, uint at, int stride) {
    const uint64_t first = address + uint64_t(at) * 4ul;
    if (stride == 1) {
        return load_row(first);
    }
    Source source = Source(first);
    float value = source.v[0];
    [[unroll]] for (int k = 1; k < LX; ++k) {
        const float next = source.v[k * stride];
        value = gl_SubgroupInvocationID == k ? next : value;
    }
    return value;
}
