#pragma once
#include <cstdint>
#include <vector>

#include "tools/io/image.hpp"
#include "tools/simulate/esim.hpp"
#include "tools/simulate/scene.hpp"

namespace ecir::sim {

/// Exposure i of a recording, microseconds from the recording's start.
struct Window {
    int64_t start_us;
    int64_t end_us;
};

/// What a frame camera saw of one exposure, and what it would have seen at `truth` moments.
struct Shot {
    io::Image blurry;
    std::vector<io::Image> truth;
};

/// d times evenly over the window, both ends included; the middle when d = 1.
std::vector<double> truth_times(const Window& window, int frames);

/// One exposure: the blurry frame is the exact mean over time of the scene, which is linear between
/// its knots,
///     B = sum_k (L_k + L_{k+1}) / 2 (t_{k+1} - t_k) / (t_end - t_start),
/// and `camera` sees every knot. The truth's moments become knots too.
/// Throws std::invalid_argument for an empty window or frames < 1, and what the scene throws.
Shot expose(Scene& scene, EventCamera& camera, const Window& window, int frames);

} // namespace ecir::sim
