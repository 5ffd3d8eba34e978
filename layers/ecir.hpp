#pragma once
#include <memory>
#include <optional>

#include "layers/histogram.hpp"
#include "layers/method.hpp"
#include "layers/refinement.hpp"
#include "layers/unet.hpp"

namespace ecir {

/// How a network was trained, from the metadata of its weights file.
struct EcirConfig {
    bool release = false;    ///< variant `release`: the published code's rules; else `paper`
    uint32_t keypoints = 10; ///< n
    uint32_t bins = 40;      ///< histogram channels m, two for each interval
    uint32_t iterations = 3; ///< of the refinement
    double span = 1;         ///< release: the U-Net's histogram covers [-span, span]

    /// Throws Error(bad_input) for metadata that is missing or out of range.
    explicit EcirConfig(const SafeTensors& weights);
};

/// What may differ from how a network was trained.
struct EcirOptions {
    std::optional<uint32_t> refine{}; ///< iterations; 0 gives the initialisation alone
    /// The refinement ends early after an iteration that changed no pixel by so many grey levels of
    /// 255, beyond the trained iterations also where changes no longer fall; 0: never. Unset: a
    /// quarter, for `release`, which reproduces published results, never.
    std::optional<float> refine_until{};
    bool ordered = false; ///< the curve's order follows the events (curve_orders())
};

/// The system of the paper (figure 3): histogram and keypoints of the events, U-Net, curve,
/// refinement. `paper` takes pixels of over prior_busy_events events as without, and brightens dark
/// frames for the networks, which trained on few, darkening their result again.
class EcirMethod : public Method {
public:
    /// Throws Error(bad_input) for weights that are not such a network's.
    EcirMethod(std::shared_ptr<Device> device, const SafeTensors& weights, uint32_t height,
               uint32_t width, const EcirOptions& options);

    void begin(const FrameInput& input) override;
    std::span<const float> finish() override;
    [[nodiscard]] MethodWork work() const override;
    [[nodiscard]] double operations() const override { return program_.operations(); }
    [[nodiscard]] std::unique_ptr<Method> resized(uint32_t height, uint32_t width) const override;

    [[nodiscard]] const EcirConfig& config() const { return config_; }
    /// Time of each dispatch of a run with the last input.
    [[nodiscard]] std::vector<DispatchTime> profile() const { return program_.profile(); }

private:
    /// On the device.
    struct Networks {
        UNet unet;
        Refinement refinement;
    };
    /// How much to do.
    struct Extent {
        uint32_t iterations;
        float settled; ///< largest change of a pixel, 0 to 1, after which no iteration follows
        bool ordered;
    };
    EcirMethod(std::shared_ptr<Device> device, const EcirConfig& config,
               std::shared_ptr<const Networks> networks, uint32_t height, uint32_t width,
               const Extent& extent);
    /// How a frame was brightened for the networks.
    struct Brightening {
        float gain = 1;
        std::vector<float> cut; ///< of the blurry frame, what the gain would have taken over 1
    };

    void record(Program& program, uint32_t frames, uint32_t capacity);
    [[nodiscard]] Brightening brighten(std::vector<float>& blurry) const;
    [[nodiscard]] std::vector<IntervalRange> intervals(const FrameInput& input,
                                                       std::span<const double> edges) const;

    std::shared_ptr<Device> device_;
    EcirConfig config_;
    std::shared_ptr<const Networks> networks_;
    uint32_t height_;
    uint32_t width_;
    Extent extent_;

    MethodProgram program_;
    struct Begun {
        Brightening brightening;
        std::vector<size_t> orders;
    };
    std::vector<Begun> begun_;   ///< the oldest first
    std::vector<size_t> orders_; ///< of the frame finished last
    std::vector<float> darkened_;
    EventTensors events_;
    Tensor blurry_;
    Tensor rule_;
    Tensor input_intervals_;
    Tensor frame_intervals_;
    Tensor matrix_;
    Tensor output_;
    std::optional<Tensor> progress_; ///< of the refinement
};

} // namespace ecir
