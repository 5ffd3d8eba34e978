#pragma once
#include <memory>

#include "layers/fusion_network.hpp"
#include "layers/method.hpp"

namespace ecir {

/// Sharp frames by the fusion network: frames of the event-driven prior, brought together along
/// estimated motion and corrected.
class FusionMethod : public Method {
public:
    /// `correct`: false for the prior alone. Throws Error(bad_input) for weights that are not such
    /// a network's.
    FusionMethod(const std::shared_ptr<Device>& device, const SafeTensors& weights, uint32_t height,
                 uint32_t width, bool correct = true);

    void begin(const FrameInput& input) override;
    std::span<const float> finish() override { return program_.finish(); }
    [[nodiscard]] double operations() const override { return program_.operations(); }
    [[nodiscard]] std::unique_ptr<Method> resized(uint32_t height, uint32_t width) const override;

    /// Time of each dispatch of a run with the last input.
    [[nodiscard]] std::vector<DispatchTime> profile() const { return program_.profile(); }

private:
    /// On the device.
    struct Networks {
        FusionTrunk trunk;
        FusionHead head;
    };
    static std::shared_ptr<const Networks> load(Device& device, const SafeTensors& weights);
    FusionMethod(std::shared_ptr<Device> device, std::shared_ptr<const Networks> networks,
                 uint32_t height, uint32_t width, uint32_t row, bool correct);
    void record(Program& program, uint32_t frames, uint32_t capacity);
    void record_prior_frames(Program& program, const PriorInput& input,
                             const PriorExposure& exposure) const;
    void record_corrected_frames(Program& program, const PriorInput& input,
                                 const PriorExposure& exposure) const;

    std::shared_ptr<Device> device_;
    std::shared_ptr<const Networks> networks_;
    uint32_t height_;
    uint32_t width_;
    uint32_t row_; ///< pixels that rows are made for (conv_layout())
    bool correct_;

    MethodProgram program_;
    EventTensors events_;
    Tensor blurry_;
    Tensor threshold_input_;
    Tensor instants_;
    Tensor output_;
};

} // namespace ecir
