#pragma once
#include <cstdint>
#include <vector>

namespace ecir {

/// [1 2 1] / 4 twice in each direction, about a Gaussian of one pixel, in place; beyond the border
/// its values repeat. plane: height x width. On the host: shaders/smooth.comp is for what stays on
/// the device.
void smooth_plane(std::vector<float>& plane, uint32_t width, uint32_t height);

} // namespace ecir
