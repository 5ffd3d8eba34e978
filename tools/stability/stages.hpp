#pragma once
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "layers/ecir.hpp"

namespace ecir::stability {

/// The nearest float16, ties to even; infinite from 65520 on.
float rounded_to_half(float value);

/// What goes from one stage of E-CIR to the next.
enum class Border {
    none,
    blurry,      ///< the blurry frame into the U-Net and the curve
    histogram,   ///< event counts into the U-Net
    network,     ///< keypoints into the U-Net
    weights,     ///< of all networks
    derivatives, ///< the U-Net's output
    keypoints,   ///< keypoints into the curve
    matrix,      ///< the curve's nodes and integrals
    initial,     ///< the curve's frames
    refined,     ///< the result
};

struct StagedFrames {
    std::vector<float> curve;
    std::vector<float> refined;
};

/// EcirMethod (layers/ecir.hpp, `paper`) in steps, the values that cross `border` rounded to
/// float16 on the way; everything within a step in float32, as always.
class StagedEcir {
public:
    StagedEcir(Device& device, const SafeTensors& weights, uint32_t width, uint32_t height);
    StagedFrames frames(const FrameInput& input, Border border);

private:
    Device& device_;
    EcirConfig config_;
    uint32_t width_;
    uint32_t height_;
    UNet unet_;
    Refinement refinement_;
};

/// What a pixel of EDI keeps while it goes through its events.
enum class EdiBorder {
    none,
    times,    ///< the events' normalised times
    sum,      ///< E(t) after each event
    integral, ///< the running integral of exp(E)
};

/// EDI (layers/edi.hpp) in float32, what `border` names stored as float16 after each event.
std::vector<float> staged_edi(const FrameInput& input, uint32_t width, uint32_t height,
                              const EdiThresholds& thresholds, EdiBorder border);

} // namespace ecir::stability
