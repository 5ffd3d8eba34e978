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
    UNet(Device& device, const SafeTensors& weights, uint32_t bins, uint32_t keypoints,
         ConvFamily family);

    /// The fastest family for images up to this size: that of rows, where each tensor is bound as a
    /// whole, while the largest fits. Throws as the constructor does.
    static ConvFamily family(const DeviceInfo& info, const SafeTensors& weights, uint32_t bins,
                             uint32_t height, uint32_t width);

    /// Of record()'s histogram and keypoints.
    [[nodiscard]] Layout input_layout(const DeviceInfo& info, uint32_t channels, uint32_t height,
                                      uint32_t width) const {
        return conv_layout(info, family_, channels, height, width, kInputHalo);
    }
    /// Of record()'s blurry frame, which other kernels read too.
    [[nodiscard]] Layout blurry_layout(const DeviceInfo& info, uint32_t height,
                                       uint32_t width) const {
        return image_layout(info, family_, 1, height, width, kInputHalo);
    }

    /// blurry: 1 channel, histogram: `bins`, keypoints: `keypoints`, their halos zeros.
    /// Returns the derivatives, `keypoints` channels, no halo.
    Tensor record(Program& program, const Tensor& blurry, const Tensor& histogram,
                  const Tensor& keypoints) const;

private:
    static constexpr uint32_t kInputHalo = 2;

    struct ResidualBlock {
        Conv first;
        Conv second;
    };

    ResidualBlock load_block(Device& device, const SafeTensors& weights, const std::string& name,
                             uint32_t channels) const;

    ConvFamily family_;
    uint32_t keypoints_;
    std::vector<Conv> encoders_;
    std::vector<uint32_t> widths_; ///< channels out of each encoder
    std::vector<ResidualBlock> blocks_;
    std::vector<Conv> decoders_;
    std::vector<uint32_t> decoder_widths_;
    uint32_t predicted_ = 0; ///< keypoints_, filled up to what every family takes
    std::unique_ptr<Conv> prediction_;
};

} // namespace ecir
