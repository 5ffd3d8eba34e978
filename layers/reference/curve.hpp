#pragma once
#include <cstdint>
#include <span>
#include <vector>

#include "layers/keypoints.hpp"
#include "layers/operations.hpp"

namespace ecir::reference {

/// The keypoints of one pixel (ascending, float32) spread to keypoint_spacing(n), step by step in
/// float32 as the kernel and the training code do it: forwards, then backwards if the last left the
/// exposure.
std::vector<float> spread_keypoints(std::span<const float> keypoints);

/// L(t) of equations 3, 6 and 7 at one pixel: the polynomial through (keypoints, derivatives)
/// integrated by Gauss-Legendre quadrature, in double. The keypoints must differ.
/// order: the polynomial is cut off before the Legendre polynomial of that degree.
double curve(std::span<const float> keypoints, std::span<const float> derivatives, double blurry,
             double t, uint32_t order = max_keypoints);

} // namespace ecir::reference

namespace ecir {

Trial curve_trial(Device& device, uint32_t trial);
/// The same cases with orders that follow events.
Trial curve_order_trial(Device& device, uint32_t trial);

} // namespace ecir
