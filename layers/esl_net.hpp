#pragma once
#include <memory>
#include <vector>

#include "layers/conv_plane.hpp"
#include "layers/histogram.hpp"
#include "layers/method.hpp"
#include "weights/safetensors.hpp"

namespace ecir {

/// eSL-Net without super-resolution (Wang, He, Yu, Xia, Yang: Event Enhanced High-Quality Image
/// Recovery, ECCV 2020), a baseline: a sparse code of the blurry frame B, gated by the events, from
/// 25 rounds of learned iterative shrinkage, from the tensors `esl.*` of a weights file.
///     G = sigmoid(event_c2 * sigmoid(event_c1 * counts))
///     Z = W1 * (image_d * B . G),  R = max(Z, 0)
///     25 times: R = max(R - S2 * (S1 * R . G . G) + Z, 0)
///     L = endconv * W2 * R
/// No layer has a bias, so L is proportional to B: grey levels of 255, which the weights were
/// trained on, need no factors around the network.
class EslNet {
public:
    /// Throws Error(bad_input) naming the tensor that is missing or of a wrong shape.
    EslNet(Device& device, const SafeTensors& weights, ConvFamily family);

    /// The fastest family for images up to this size.
    static ConvFamily family(const DeviceInfo& info, uint32_t height, uint32_t width);
    /// Of record()'s blurry frame and histogram.
    [[nodiscard]] Layout blurry_layout(const DeviceInfo& info, uint32_t height,
                                       uint32_t width) const {
        return image_layout(info, family_, 1, height, width);
    }
    [[nodiscard]] Layout histogram_layout(const DeviceInfo& info, uint32_t height,
                                          uint32_t width) const {
        return conv_layout(info, family_, 4 * bins, height, width);
    }

    static constexpr uint32_t bins = 20; ///< time intervals on either side of the frame's instant

    /// blurry; histogram: two channels for each of outward_intervals();
    /// output: 1 channel, any layout.
    void record(Program& program, const Tensor& blurry, const Tensor& histogram,
                const Tensor& output) const;

private:
    ConvFamily family_;
    Conv image_d_;
    Conv event_c1_;
    Conv event_c2_;
    Conv w1_;
    Conv s1_;
    Conv s2_; ///< negated, so that a residual is what it is subtracted from
    Conv w2_;
    ConvPlane endconv_;
};

/// Sharp frames by eSL-Net: one run of the network a frame, whose time comes in through the event
/// counts alone.
class EslNetMethod : public Method {
public:
    EslNetMethod(const std::shared_ptr<Device>& device, const SafeTensors& weights, uint32_t height,
                 uint32_t width);

    /// Does all the work, so that frames do not overlap; each takes the device long.
    void begin(const FrameInput& input) override;
    std::span<const float> finish() override;
    [[nodiscard]] double operations() const override { return program_.operations(); }
    [[nodiscard]] std::unique_ptr<Method> resized(uint32_t height, uint32_t width) const override;

    /// Time of each dispatch of a run for the last frame.
    [[nodiscard]] std::vector<DispatchTime> profile() const { return program_.profile(); }

private:
    EslNetMethod(std::shared_ptr<Device> device, std::shared_ptr<const EslNet> network,
                 uint32_t height, uint32_t width);
    void record(Program& program, uint32_t capacity);

    std::shared_ptr<Device> device_;
    std::shared_ptr<const EslNet> network_;
    uint32_t height_;
    uint32_t width_;

    MethodProgram program_; ///< makes one frame
    EventTensors events_;
    Tensor blurry_;
    Tensor intervals_;
    Tensor output_;
    std::vector<std::vector<float>> made_; ///< the oldest first
    std::vector<float> finished_;
};

} // namespace ecir
