#pragma once
#include <memory>
#include <optional>

#include "layers/edi_threshold.hpp"
#include "layers/method.hpp"

namespace ecir {

/// EDI (layers/edi.hpp) with given thresholds, or estimated ones (EdiThresholdSource).
class EdiMethod : public Method {
public:
    EdiMethod(std::shared_ptr<Device> device, uint32_t height, uint32_t width,
              std::optional<EdiThresholds> thresholds);

    FrameFacts begin(const FrameInput& input) override;
    std::span<const float> finish() override { return program_.finish(); }
    [[nodiscard]] double operations() const override { return program_.operations(); }

private:
    void record(Program& program, uint32_t frames, uint32_t capacity);

    std::shared_ptr<Device> device_;
    uint32_t height_;
    uint32_t width_;
    EdiThresholdSource source_;

    MethodProgram program_;
    EventTensors events_;
    Tensor blurry_;
    Tensor thresholds_;
    Tensor schedule_;
    Tensor busy_;
    Tensor output_;
};

} // namespace ecir
