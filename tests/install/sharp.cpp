// The README's example: a blurry frame and its events to 14 sharp frames.
#include <cstdio>

#include "layers/deblur.hpp"

int main() {
    const uint32_t width = 64;
    const uint32_t height = 48;
    const std::vector<float> blurry(width * height, 0.5F); // luminance, 0 ... 1
    ecir::Events events;                                   // microseconds, column, row, polarity
    for (uint16_t x = 0; x < 40; ++x) {                    // a bright edge that moves to the right
        for (uint16_t y = 8; y < 40; ++y) {
            events.push_back(200 * x, x, y, 1);
        }
    }
    ecir::Deblur deblur(ecir::Device::open(), {}, width, height);
    const auto frames = deblur.frames(blurry, events.view(), {0, 10'000}, ecir::even_times(14));
    std::printf("%zu frames, model %s\n", frames.size() / blurry.size(),
                ecir::find_model("fusion").c_str());
}
