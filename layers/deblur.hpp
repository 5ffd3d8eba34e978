#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "layers/edi.hpp"
#include "layers/events.hpp"
#include "layers/model_family.hpp"
#include "layers/regions.hpp"
#include "layers/scene_facts.hpp"
#include "runtime/device.hpp"

namespace ecir {

class EdiThresholdSource;
class Method;
struct MethodWork;
class WindowedMethod;

struct DeblurOptions {
    /// A shipped model's name, the path of a .safetensors file, `edi`, or `auto`: for each frame
    /// the smallest fusion network that does for its scene (ModelFamily).
    std::string model = "auto";
    /// With `auto`: what may be given up for speed.
    Quality quality = Quality::best;
    /// With `auto`: the largest model to choose; empty: any.
    std::string largest;
    /// Iterations of the refinement; 0 for the initialisation alone (the curve of E-CIR, the prior
    /// of a fusion network, which takes 0 to 2 only, see FusionSteps). Unset: as trained, all.
    std::optional<uint32_t> refine;
    /// Of E-CIR: the refinement ends early after an iteration that changed no pixel by so many grey
    /// levels of 255, beyond the trained iterations also where changes no longer fall; 0: never.
    /// Unset: a quarter, for the `release` variant never.
    std::optional<float> refine_until;
    /// Of E-CIR: the curve's order follows the events that a pixel and its neighbours have,
    /// constant without any (layers/curve.hpp). Saves nothing on lavapipe, and refined frames are
    /// as good.
    bool ordered = false;
    /// Keypoints of the curve; must be what the model was trained for.
    std::optional<uint32_t> keypoints;
    /// For `edi` and fusion networks; unset: estimated from the frames and their events, those of
    /// the first frames for all that follow (EdiThresholdTrack).
    std::optional<EdiThresholds> thresholds;
    /// Compute only what moves (see Deblur). False: the whole image, to the same result within a
    /// tenth of a grey level of 255.
    bool regions = true;
};

/// The library's main entry: a motion-blurred frame and the events of its exposure to sharp frames
/// at any times of the exposure. One object serves one sensor, whose contrast thresholds it may
/// learn from frame to frame, and one image size; a program is recorded at the first frame and
/// replayed as long as the number of times stays.
///
/// Where nothing moves the blurry frame is the answer already. So a network's correction counts in
/// full where events fell as motion makes them (moving_cells()), fades out over 8 pixels around,
/// and beyond there are the blurry frame's own values; unless nearly all of the
/// image moves (find_regions()), where it counts everywhere. `edi`, and a fusion network's prior
/// alone, change no pixel without events. What is left to compute is computed in windows. E-CIR's
/// `release` variant, whose clock is all events', is computed whole.
class Deblur {
public:
    /// Throws Error: bad_input for a model that cannot be found or read, usage for options that the
    /// model does not take, and for a `largest` that `auto` does not choose from.
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

    /// Motion that the model, with `auto` each of them, is good for.
    [[nodiscard]] TravelRange travel_range() const { return members_.back().model.travel; }

    /// Pixels of the frame finished last with more events than a network takes
    /// (prior_busy_events), to which they were pixels without events. 0 for `edi`, eSL-Net and the
    /// `release` variant of E-CIR, which take them all.
    [[nodiscard]] size_t ignored_pixels() const { return ignored_pixels_; }

    /// Share of the image that moved in the frame finished last, 0 to 1: of the cells that
    /// moving_cells() finds (touched_cells() for `edi`); 1 for a model that is computed whole.
    [[nodiscard]] double active_share() const { return active_share_; }
    /// What was computed of it; none where nothing moved.
    [[nodiscard]] const std::vector<PixelRect>& windows() const { return computed_; }

    /// What made the frame finished last: the model, with `auto` the one chosen; empty where
    /// nothing moved.
    [[nodiscard]] const std::string& model() const { return used_; }

    /// What it took for the frame finished last, by window (layers/method.hpp).
    [[nodiscard]] const std::vector<MethodWork>& work() const { return work_; }

    /// Floating-point operations of the kernels for the frame begun last, at the most; 0 before the
    /// first one with events.
    [[nodiscard]] double operations() const { return operations_; }

private:
    /// A frame begun and not finished.
    struct Begun {
        std::vector<size_t> order; ///< of the times, ascending
        std::optional<EdiThresholds> thresholds;
        size_t ignored_pixels = 0;
        double active_share = 0;
        std::vector<PixelRect> windows;
        size_t member = 0;
        std::vector<float> still; ///< the result, where nothing moved
    };
    /// What is particular to a model.
    struct Model {
        std::unique_ptr<Method> method;
        RegionRule rule;
        bool local = true;           ///< what happens far away does not matter
        bool pixel_by_pixel = false; ///< and what happens beside a pixel neither
        bool has_thresholds = false;
        bool follows_motion = false;      ///< the rule's context grows with the travel
        bool ignores_busy_pixels = false; ///< as prior_busy_events says
        TravelRange travel{};
    };
    /// A model to choose from.
    struct Member {
        std::string name;
        Model model;                            ///< without the method
        std::unique_ptr<WindowedMethod> method; ///< made when first needed
    };
    [[nodiscard]] Model make_model(const std::string& name) const;
    Member& member(size_t index);
    [[nodiscard]] size_t choose_member(const EventView& events, double active_share) const;
    /// Regions to compute, and the share of the image that moved.
    Regions find_work(const Model& model, std::span<const float> blurry, const EventView& events,
                      const Exposure& exposure, double& active_share) const;

    std::shared_ptr<Device> device_;
    DeblurOptions options_;
    std::optional<ModelFamily> family_;          ///< with `auto`
    std::vector<Member> members_;                ///< smallest first
    std::unique_ptr<EdiThresholdSource> source_; ///< of models that have thresholds
    uint32_t width_;
    uint32_t height_;
    std::vector<Begun> begun_; ///< the oldest first
    std::optional<EdiThresholds> thresholds_;
    size_t ignored_pixels_ = 0;
    double active_share_ = 0;
    std::vector<PixelRect> computed_;
    std::string used_;
    std::vector<MethodWork> work_;
    double operations_ = 0;
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
