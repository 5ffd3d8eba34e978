#pragma once
#include <memory>

#include "layers/method.hpp"

namespace ecir {

/// EDI (layers/edi.hpp).
class EdiMethod : public Method {
public:
    EdiMethod(std::shared_ptr<Device> device, uint32_t height, uint32_t width);

    void begin(const FrameInput& input) override;
    std::span<const float> finish() override { return program_.finish(); }
    [[nodiscard]] double operations() const override { return program_.operations(); }
    [[nodiscard]] std::unique_ptr<Method> resized(uint32_t height, uint32_t width) const override;

private:
    void record(Program& program, uint32_t frames, uint32_t capacity);

    std::shared_ptr<Device> device_;
    uint32_t height_;
    uint32_t width_;

    MethodProgram program_;
    EventTensors events_;
    Tensor blurry_;
    Tensor thresholds_;
    Tensor schedule_;
    Tensor busy_;
    Tensor output_;
};

} // namespace ecir
