// The README's example: a blurry frame and its events to 14 sharp frames.
#include <cstdio>

#include "layers/deblur.hpp"

int main() {
    const uint32_t width = 64;
    const uint32_t height = 48;
    const std::vector<float> blurry(width * height, 0.5F); // luminance, 0 ... 1
    ecir::Events events;                                   // microseconds, column, row, polarity
    events.push_back(2'000, 10, 20, 1);
    ecir::Deblur deblur(ecir::Device::open(), {.model = "fusion"}, width, height);
    const auto frames = deblur.frames(blurry, events.view(), {0, 10'000}, ecir::even_times(14));
    std::printf("%zu frames, model %s\n", frames.size() / blurry.size(),
                ecir::find_model("fusion").c_str());
}
