#pragma once
#include <array>
#include <memory>
#include <optional>

#include "layers/agreement.hpp"
#include "layers/fusion_network.hpp"
#include "layers/method.hpp"

namespace ecir {

/// What a fusion network does to frames of the event-driven prior, each including those before.
enum class FusionSteps : uint32_t {
    prior,     ///< nothing
    corrected, ///< brings them together along estimated motion and corrects them
    agreed,    ///< averages corrected frames along the motion as far as they agree
};

/// Sharp frames by the fusion network.
class FusionMethod : public Method {
public:
    /// Throws Error(bad_input) for weights that are not such a network's.
    FusionMethod(const std::shared_ptr<Device>& device, const SafeTensors& weights, uint32_t height,
                 uint32_t width, FusionSteps steps = FusionSteps::agreed);

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
                 uint32_t height, uint32_t width, FusionSteps steps);
    /// By reference (layers/agreement.hpp) the index of its time among the wanted ones, or none.
    using Shared = std::array<std::optional<uint32_t>, reference_count>;
    static Shared find_shared(std::span<const double> times);

    struct Correction;
    void record(Program& program, uint32_t frames, const Shared& shared, uint32_t capacity);
    void record_prior_frames(Program& program, const PriorInput& input,
                             const PriorExposure& exposure) const;
    Correction record_correction(Program& program, const PriorInput& input,
                                 const PriorExposure& exposure) const;
    void record_corrected_frames(Program& program, const Correction& correction) const;
    void record_agreed_frames(Program& program, const Correction& correction,
                              const Shared& shared) const;
    /// After the frame with that index in output_, and of its prior.
    void record_kept(Program& program, const Correction& correction, const Tensor& prior,
                     uint32_t frame) const;

    std::shared_ptr<Device> device_;
    std::shared_ptr<const Networks> networks_;
    uint32_t height_;
    uint32_t width_;
    FusionSteps steps_;

    MethodProgram program_;
    Shared shared_; ///< of the program
    EventTensors events_;
    Tensor blurry_;
    Tensor threshold_input_;
    Tensor instants_;
    Tensor output_;
};

} // namespace ecir
