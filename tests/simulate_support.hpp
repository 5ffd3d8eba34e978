#pragma once
#include <cmath>
#include <functional>

#include "layers/events.hpp"
#include "tools/io/image.hpp"
#include "tools/simulate/esim.hpp"
#include "tools/simulate/motion.hpp"

namespace ecir::test {

using namespace ecir::sim;

inline CameraModel ideal(double positive = 0.2, double negative = 0.2) {
    CameraModel model;
    model.positive = positive;
    model.negative = negative;
    model.sigma = 0;
    return model;
}

inline io::Image picture(int width, int height, const std::function<double(int, int)>& value) {
    io::Image image{width, height, 1, 8, {}};
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            image.pixels.push_back(static_cast<float>(value(x, y)));
        }
    }
    return image;
}

inline io::Image waves(int width, int height) {
    return picture(width, height, [](int x, int y) {
        return 0.5 + 0.25 * std::sin(0.35 * x) + 0.2 * std::cos(0.27 * y + 0.1 * x);
    });
}

inline bool equal(const Events& a, const Events& b) {
    return a.t == b.t && a.x == b.x && a.y == b.y && a.p == b.p;
}

inline Motion moving(Path path, double travel, double angle = 0, double rotate = 0,
                     double zoom = 1) {
    Motion motion;
    motion.path = path;
    motion.travel_px = travel;
    motion.angle_deg = angle;
    motion.rotate_deg = rotate;
    motion.zoom = zoom;
    return motion;
}

} // namespace ecir::test
