#pragma once
#include <functional>

#include "tools/stability/sweep.hpp"

namespace ecir::stability {

using Make = std::function<Capture(const Subject&, double)>;

/// What a method makes of a capture.
struct Found {
    std::vector<float> frames;         ///< at the times of the truth
    std::vector<std::string> warnings; ///< names of those that the report gives
};
/// Throws what Deblur throws.
Found find_frames(const Lab& lab, const Method& method, const Capture& capture);

/// Root mean square, in grey levels of 8 bits, of a - b, clipped to what an image can hold.
double rms_levels(std::span<const float> a, std::span<const float> b);

/// PSNR, dB, of frames against the truth, both clipped and as if rounded to 8 bits: a difference
/// far below a grey level counts as a rounding of 1 / sqrt(12) levels, so identical frames
/// have 58.9 dB.
double psnr(std::span<const float> frames, const Capture& capture);

/// Completes a sweep whose figure is each method's PSNR, with the blurry frame's as reference. It
/// fails where a method's is over 0.5 dB lower, a value is not finite, or the method throws.
Sweep against_blurry(Sweep sweep, Make make);

/// Completes a sweep whose figure is how far the frames are from those of another capture, which
/// must give the same ones: RMS in grey levels, over all pixels where `look` holds. Fails over
/// `limit` (1 level where the sweep sets none).
Sweep against_same(Sweep sweep, const Make& make, const Make& same,
                   const std::function<bool(const Subject&, uint32_t x, uint32_t y)>& look = {});

} // namespace ecir::stability
