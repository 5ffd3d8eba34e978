#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <span>

#include "layers/edi_moments.hpp"
#include "layers/edi_track.hpp"
#include "layers/event_pack.hpp"

namespace ecir {

/// Estimates the contrast thresholds of layers/edi.hpp from a blurry frame and its events alone.
///
/// Where brightness only moves, dX/dt + v . grad X = 0 for X = ln(L + e) and the local motion v.
/// With the thresholds' common size off by a factor f, X is close to f X* + (1 - f) b, a mixture of
/// the true X* with the unmoving blurry b = ln(B + e), and the left side becomes
/// (1 - f) v . grad b. So at the right size the rest that a motion fitted tile by tile leaves is
/// uncorrelated with v . grad b; and the right ratio is where the rest has no drift, since c+ too
/// large brightens every pixel that edges pass. The noise of the events is in the rest but not in
/// b, so it does not bias the first test. Tiles count by how well one motion explains them.
///
/// Events that come late by a share s of the exposure make X(t) = X*(t - s) + s S to first order in
/// s, S being what the whole exposure changes: the blurry frame is the mean of another stretch of
/// time than the events tell of. The left side is then s v . grad S, and regressing the rest on
/// both it and v . grad b tells s.

/// The tests for some thresholds, each with its standard error (infinite: no information).
struct EdiBalance {
    double blur = 0;  ///< sum (v . grad b)(rest) / sum (v . grad b)^2; about 1 - f
    double drift = 0; ///< sum rest / sum |dX|
    double blur_error = 0;
    double drift_error = 0;
    double lag = 0; ///< of the events, as a share of the exposure; too small where it is large
    double lag_error = 0;
};

/// Sums the moments of record_edi_moments() in a fixed order; the errors take tiles as independent.
EdiBalance edi_balance(std::span<const float> moments, uint32_t tiles);

/// The thresholds at which both tests come out 0, each within its error, traded off against a wide
/// prior around 0.2 for both signs, which decides where events or texture are few. Always within
/// 0.04 to 0.8. Calls `balance` at most 8 times, mostly 4.
EdiEstimate solve_edi_thresholds(const std::function<EdiBalance(const EdiThresholds&)>& balance);

/// The estimation on a device, for sensors of one size (16 x 16 or more).
class EdiThresholdEstimator {
public:
    EdiThresholdEstimator(Device& device, uint32_t width, uint32_t height);

    /// blurry: height x width values in [0, 1]. Throws Error(bad_input) for events or an image of
    /// another size. The same input gives the same thresholds to the bit.
    EdiEstimate estimate(const PackedEvents& events, std::span<const float> blurry);

    /// The tests for given thresholds.
    EdiBalance balance(const PackedEvents& events, std::span<const float> blurry,
                       const EdiThresholds& thresholds);

private:
    void prepare(const PackedEvents& events, std::span<const float> blurry);
    void record(uint32_t capacity);
    EdiBalance run(const EdiThresholds& thresholds);

    Device& device_;
    uint32_t width_;
    uint32_t height_;
    EdiMomentShape shape_;
    uint32_t capacity_ = 0;                ///< events that the programs take
    std::unique_ptr<Program> field_maker_; ///< runs once a frame
    EdiInput frame_;
    Tensor fields_;
    std::unique_ptr<Program> tester_; ///< runs for each thresholds tested
    EdiInput tested_;
    Tensor tested_fields_;
    Tensor moments_;
};

/// Thresholds for one frame of a sensor after the other: given, or estimated from the frames and
/// events up to then as EdiThresholdTrack says; 0.2 on sensors too small to estimate from.
class EdiThresholdSource {
public:
    EdiThresholdSource(Device& device, uint32_t width, uint32_t height,
                       std::optional<EdiThresholds> given);

    /// events, exposure: as pack_events() takes them; blurry: height x width values in [0, 1].
    EdiThresholds choose(const EventView& events, const Exposure& exposure,
                         std::span<const float> blurry);

private:
    uint32_t width_;
    uint32_t height_;
    std::optional<EdiThresholds> given_;
    std::unique_ptr<EdiThresholdEstimator> estimator_; ///< only where thresholds were not given
    EdiThresholdTrack track_;
};

} // namespace ecir
