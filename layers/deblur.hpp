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
    /// of a fusion network, which otherwise refines once whatever is asked). Unset: as trained.
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

    /// What `edi` or a fusion network used for the last frame.
    [[nodiscard]] std::optional<EdiThresholds> thresholds() const;

    /// Pixels of the last frame with more events than a fusion network takes (prior_busy_events),
    /// to which they were pixels without events. 0 for the other models.
    [[nodiscard]] size_t ignored_pixels() const { return ignored_pixels_; }

private:
    std::unique_ptr<Method> method_;
    uint32_t width_;
    uint32_t height_;
    size_t ignored_pixels_ = 0;
};

/// count times evenly from -1 to 1, both included; {0} for one.
std::vector<double> even_times(uint32_t count);

/// Where a model's weights are: the path itself if it ends in .safetensors, else the shipped model
/// of that name in the installation this program belongs to, or in the build tree. Throws
/// Error(bad_input) naming the places looked at and the models that there are.
std::filesystem::path find_model(const std::string& name);

/// Colour from a deblurred luminance: c + e = (b_c + e) (l + e) / (b_y + e), e = 0.01, for each
/// pixel and channel. blurry: pixels x channels; luminance_blurry, luminance: one value a pixel.
std::vector<float> recolour(std::span<const float> blurry, std::span<const float> luminance_blurry,
                            std::span<const float> luminance, uint32_t channels);

} // namespace ecir
