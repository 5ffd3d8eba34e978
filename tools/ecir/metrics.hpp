#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace ecir::metrics {

/// An 8-bit frame: rows from the top, channels interleaved.
struct Frame {
    int width = 0;
    int height = 0;
    int channels = 1;
    std::vector<uint8_t> values; ///< height x width x channels
};

/// Floats to 8 bits as the published evaluation does it: clipped to [0, 1], times 255 in float32,
/// and truncated, not rounded.
std::vector<uint8_t> to_8_bit(std::span<const float> values);

/// The figures of one frame, over all its values.
struct Figures {
    double nrmse =
        0; ///< sqrt(mean (p - t)^2) / sqrt(mean t^2); infinite where only the truth is black
    double psnr = 0; ///< 10 log10(255^2 / mean (p - t)^2); infinite where the frames are identical
    double ssim = 0; ///< see ssim()
};

/// Structural similarity as scikit-image 0.19's structural_similarity gives it for 8-bit images: 7
/// x 7 uniform window, K1 = 0.01, K2 = 0.03, data range 255, sample covariance, in double, averaged
/// without the 3 border pixels, then over the channels. Both frames of one shape, at least 7 x 7;
/// else std::invalid_argument.
double ssim(const Frame& truth, const Frame& prediction);

/// All three. Shapes as for ssim().
Figures compare(const Frame& truth, const Frame& prediction);

/// The mean of each figure over frames; at least one.
Figures mean(std::span<const Figures> frames);

} // namespace ecir::metrics
