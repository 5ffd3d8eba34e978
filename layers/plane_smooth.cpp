#include "layers/plane_smooth.hpp"

#include <algorithm>

namespace ecir {

void smooth_plane(std::vector<float>& plane, uint32_t width, uint32_t height) {
    std::vector<float> scratch(plane.size());
    for (int pass = 0; pass < 2; ++pass) {
        for (uint32_t y = 0; y < height; ++y) {
            const float* const row = &plane[size_t{y} * width];
            float* const out = &scratch[size_t{y} * width];
            for (uint32_t x = 0; x < width; ++x) {
                const float left = row[x > 0 ? x - 1 : 0];
                const float right = row[std::min(x + 1, width - 1)];
                out[x] = 0.25F * (left + right) + 0.5F * row[x];
            }
        }
        for (uint32_t y = 0; y < height; ++y) {
            const float* const up = &scratch[size_t{y > 0 ? y - 1 : 0} * width];
            const float* const here = &scratch[size_t{y} * width];
            const float* const down = &scratch[size_t{std::min(y + 1, height - 1)} * width];
            float* const out = &plane[size_t{y} * width];
            for (uint32_t x = 0; x < width; ++x) {
                out[x] = 0.25F * (up[x] + down[x]) + 0.5F * here[x];
            }
        }
    }
}

} // namespace ecir
