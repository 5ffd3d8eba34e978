#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "layers/edi.hpp"
#include "layers/events.hpp"
#include "runtime/device.hpp"

namespace ecir {

class Method;

struct DeblurOptions {
    /// A shipped model's name, the path of a .safetensors file, or `edi`.
    std::string model = "fusion";
    /// Iterations of the refinement; 0 for the initialisation alone (the curve of E-CIR, the prior
    /// of a fusion network, which takes 0 and 1 only). Unset: as trained.
    std::optional<uint32_t> refine;
    /// Keypoints of the curve; must be what the model was trained for.
    std::optional<uint32_t> keypoints;
    /// For `edi` and fusion networks; unset: estimated from the frames and their events, those of
    /// the first frames for all that follow (EdiThresholdTrack).
    std::optional<EdiThresholds> thresholds;
};

/// The library's main entry: a motion-blurred frame and the events of its exposure to sharp frames
/// at any times of the exposure. One object serves one sensor, whose contrast thresholds it may
/// learn from frame to frame, and one image size; a program is recorded at the first frame and
/// replayed as long as the number of times stays.
class Deblur {
public:
    /// Throws Error: bad_input for a model that cannot be found or read, usage for options that the
    /// model does not take.
    Deblur(std::shared_ptr<Device> device, const DeblurOptions& options, uint32_t width,
           uint32_t height);
    ~Deblur();
    Deblur(Deblur&&) noexcept;
    Deblur& operator=(Deblur&&) = delete;

    /// blurry: height x width luminance in 0 ... 1, but for rounding. events: sorted by time,
    /// coordinates inside the image; those outside the exposure are ignored, and without any left
    /// every frame is the blurry one. times: normalised, -1 the start and 1 the end of the
    /// exposure, in any order. Returns times x height x width in the order of `times`, not clipped.
    /// Throws Error: bad_input for another number of values, a value outside 0 ... 1, and what
    /// pack_events() refuses, usage for a time outside -1 ... 1, resources where memory is short;
    /// the object stays usable.
    std::vector<float> frames(std::span<const float> blurry, const EventView& events,
                              const Exposure& exposure, std::span<const double> times);

    /// frames() in two halves, for recordings: begin() starts on a frame, of whose input nothing is
    /// needed afterwards; finish() waits for the oldest frame begun. With one frame begun and the
    /// next one begun before the first is finished, the host prepares and reads back while the
    /// device works; more at a time gain nothing. Where begin() throws nothing was begun. frames()
    /// is for when nothing is.
    void begin(std::span<const float> blurry, const EventView& events, const Exposure& exposure,
               std::span<const double> times);
    std::vector<float> finish();

    /// What `edi` or a fusion network used for the frame finished last; none for one without
    /// events.
    [[nodiscard]] std::optional<EdiThresholds> thresholds() const { return thresholds_; }

    /// Pixels of the frame finished last with more events than a network takes
    /// (prior_busy_events), to which they were pixels without events. 0 for `edi`, eSL-Net and the
    /// `release` variant of E-CIR, which take them all.
    [[nodiscard]] size_t ignored_pixels() const { return ignored_pixels_; }

    /// Floating-point operations of the kernels for one frame, of as many times as the last; 0
    /// before the first one with events.
    [[nodiscard]] double operations() const;

private:
    /// A frame begun and not finished.
    struct Begun {
        std::vector<size_t> order; ///< of the times, ascending
        std::optional<EdiThresholds> thresholds;
        size_t ignored_pixels = 0;
        std::vector<float> still; ///< the result, where there were no events
    };

    std::unique_ptr<Method> method_;
    uint32_t width_;
    uint32_t height_;
    std::vector<Begun> begun_; ///< the oldest first
    std::optional<EdiThresholds> thresholds_;
    size_t ignored_pixels_ = 0;
};

/// count times evenly from -1 to 1, both included; {0} for one.
std::vector<double> even_times(uint32_t count);

/// Where a model's weights are: the path itself if it ends in .safetensors, else the shipped model
/// of that name in the installation this program belongs to, or in the build tree. Throws
/// Error(bad_input) naming the places looked at and the models that there are.
std::filesystem::path find_model(const std::string& name);

/// `edi` and the shipped models that find_model() finds, by name.
std::vector<std::string> model_names();

/// Colour from a deblurred luminance: c + e = (b_c + e) (l + e) / (b_y + e), e = 0.01, for each
/// pixel and channel. blurry: pixels x channels; luminance_blurry, luminance: one value a pixel.
std::vector<float> recolour(std::span<const float> blurry, std::span<const float> luminance_blurry,
                            std::span<const float> luminance, uint32_t channels);

} // namespace ecir
