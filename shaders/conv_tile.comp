#version 450
// Convolution tiles in float32: conv_tile.glsl.
#extension GL_EXT_control_flow_attributes : require
#extension GL_GOOGLE_include_directive : require
#define VALUE float
#define VALUE4 vec4
#include "conv_tile.glsl"
