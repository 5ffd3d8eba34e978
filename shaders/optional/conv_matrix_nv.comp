#version 450
// Convolutions by the matrices of VK_NV_cooperative_matrix, the form that older drivers and compilers have:
// conv_matrix.glsl.
#extension GL_GOOGLE_include_directive : require
#extension GL_NV_cooperative_matrix : require
#define PIXELS fcoopmatNV<16, gl_ScopeSubgroup, M, K>
#define WEIGHTS fcoopmatNV<16, gl_ScopeSubgroup, K, N>
#define SUMS fcoopmatNV<32, gl_ScopeSubgroup, M, N>
#define LOAD(matrix, from, at, pitch) coopMatLoadNV(matrix, from, at, pitch, false)
#define STORE(matrix, to, at, pitch) coopMatStoreNV(matrix, to, at, pitch, false)
#define MULTIPLY_ADD(a, b, c) coopMatMulAddNV(a, b, c)
#include "conv_matrix.glsl"
