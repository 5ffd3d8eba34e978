#pragma once
#include "layers/conv.hpp"

namespace ecir {

/// A convolution with zero padding and one output channel, as two kernels: every tap's dot
/// product over the channels at each pixel (a 1x1 convolution to kernel^2 planes, where the lanes
/// or vectors over output channels are full), then the sum of the taps' planes, each shifted by its
/// tap.
class ConvPlane {
public:
    /// weight: [1][channels][kernel][kernel].
    ConvPlane(Device& device, uint32_t channels, uint32_t kernel, std::span<const float> weight,
              float bias, ConvFamily family);

    /// input: conv_layout() of the family, any halo; output: 1 channel, any layout; its halo is not
    /// written. added: what the result is added to, 1 channel of the output's size, any layout.
    void record(Program& program, const Tensor& input, const Tensor& output,
                const std::optional<Tensor>& added = {}) const;

private:
    Device& device_;
    uint32_t kernel_;
    ConvFamily family_;
    uint32_t planes_; ///< kernel^2, filled up to what every family takes
    Conv taps_;
};

} // namespace ecir
