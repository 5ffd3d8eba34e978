#pragma once
#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <string>

#include "runtime/error.hpp"
#include "runtime/tensor.hpp"

namespace ecir {

/// value / divisor, rounded up.
constexpr uint32_t ceil_div(uint32_t value, uint32_t divisor) {
    return (value + divisor - 1) / divisor;
}

/// The least multiple that is not below the value.
constexpr uint32_t round_up(uint32_t value, uint32_t multiple) {
    return ceil_div(value, multiple) * multiple;
}

/// Pixels of the rows that images `width` wide lie in, by rows (conv_layout()): 384, 768, then
/// multiples of 128, as memory counts. Pipelines of the row family depend on them, and take a CPU
/// driver seconds to compile; so all levels of a network share theirs up to 384, and so do images.
/// Narrow levels with gaps between their rows are as fast as without on lavapipe, and the first run
/// of `fusion` takes 0.62 of the time, with 10 of their pipelines instead of 15.
constexpr uint32_t row_pixels(uint32_t width) {
    constexpr uint32_t kNarrow = 384;
    constexpr uint32_t kMiddling = 768;
    if (width > kMiddling) {
        return round_up(width, 128);
    }
    return width > kNarrow ? kMiddling : kNarrow;
}

/// What the layers share to check tensors and to tell kernels where they lie.

/// Origin of a dense tensor as a kernel sees it that reads `words` floats as one element.
inline uint32_t origin(const Tensor& tensor, uint32_t words = 1) {
    return PushLayout(tensor).origin / words;
}

inline bool has_shape(const Tensor& tensor, uint32_t channels, uint32_t height, uint32_t width) {
    const Layout& layout = tensor.layout();
    return layout.channels == channels && layout.height == height && layout.width == width;
}

/// Rows and planes follow each other without gaps.
inline bool is_dense(const Tensor& tensor) {
    const Layout& layout = tensor.layout();
    return layout.halo == 0 && layout.pitch == 0 && layout.row_channels == 0;
}

/// "9x45x61 block 8 halo 1": channels, height, width.
inline std::string shape_text(const Tensor& tensor) {
    const Layout& layout = tensor.layout();
    return std::to_string(layout.channels) + "x" + std::to_string(layout.height) + "x" +
           std::to_string(layout.width) +
           (layout.block > 1 ? " block " + std::to_string(layout.block) : "") +
           (layout.row_channels > 0 ? " by rows" : "") +
           (layout.halo > 0 ? " halo " + std::to_string(layout.halo) : "");
}

/// Throws Error(bad_input) that names the operation and the shapes unless they are good.
inline void require_shapes(bool good, const std::string& operation,
                           std::initializer_list<Tensor> tensors) {
    if (good) {
        return;
    }
    std::string text;
    for (const Tensor& tensor : tensors) {
        text += (text.empty() ? "" : ", ") + shape_text(tensor);
    }
    throw Error(ExitCode::bad_input, operation + ": tensors of " + text + " do not fit together");
}

} // namespace ecir
