#pragma once
#include <memory>
#include <vector>

#include "layers/conv.hpp"
#include "runtime/program.hpp"
#include "weights/safetensors.hpp"

namespace ecir {

/// The U-Net of the initialisation (figure 3 of the paper): blurry frame, event histogram and
/// keypoints to dL/dt at the keypoints, from the tensors `unet.*` of a weights file, of any width.
/// Batch norms are folded into the convolutions before them.
class UNet {
public:
    /// `bins` histogram channels, `keypoints` outputs. Throws Error(bad_input) naming the tensor
    /// that is missing or of a wrong shape.
    UNet(Device& device, const SafeTensors& weights, uint32_t bins, uint32_t keypoints);

    /// blurry: 1 channel, histogram: `bins`, keypoints: `keypoints`, all with the halo kInputHalo.
    /// Returns the derivatives, `keypoints` channels, block channel_block(), no halo.
    Tensor record(Program& program, const Tensor& blurry, const Tensor& histogram,
                  const Tensor& keypoints) const;

    static constexpr uint32_t kInputHalo = 2;

private:
    struct ResidualBlock {
        Conv first;
        Conv second;
    };

    ResidualBlock load_block(Device& device, const SafeTensors& weights, const std::string& name,
                             uint32_t channels) const;

    uint32_t keypoints_;
    std::vector<Conv> encoders_;
    std::vector<uint32_t> widths_; ///< channels out of each encoder
    std::vector<ResidualBlock> blocks_;
    std::vector<Conv> decoders_;
    std::vector<uint32_t> decoder_widths_;
    std::unique_ptr<Conv> prediction_;
};

} // namespace ecir
