#version 450
// Convolutions by the matrices of VK_KHR_cooperative_matrix: conv_matrix.glsl.
#extension GL_GOOGLE_include_directive : require
#extension GL_KHR_cooperative_matrix : require
#define PIXELS coopmat<float16_t, gl_ScopeSubgroup, M, K, gl_MatrixUseA>
#define WEIGHTS coopmat<float16_t, gl_ScopeSubgroup, K, N, gl_MatrixUseB>
#define SUMS coopmat<float, gl_ScopeSubgroup, M, N, gl_MatrixUseAccumulator>
#define LOAD(matrix, from, at, pitch) coopMatLoad(matrix, from, at, pitch, gl_CooperativeMatrixLayoutRowMajor)
#define STORE(matrix, to, at, pitch) coopMatStore(matrix, to, at, pitch, gl_CooperativeMatrixLayoutRowMajor)
#define MULTIPLY_ADD(a, b, c) coopMatMulAdd(a, b, c)
#include "conv_matrix.glsl"
