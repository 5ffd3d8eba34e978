#version 450
// Convolution tiles that multiply in float16: conv_tile.glsl.
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_shader_16bit_storage : require
#extension GL_EXT_shader_explicit_arithmetic_types_float16 : require
#define HALF
#define VALUE float16_t
#define VALUE4 f16vec4
#include "conv_tile.glsl"
