#pragma once
#include <cstddef>
#include <functional>
#include <vector>

#include "layers/edi.hpp"

namespace ecir {

/// Contrast thresholds estimated from one frame and its events, and the standard errors of what
/// they say: ln of the geometric mean of c+ and c-, and ln(c+ / c-).
struct EdiEstimate {
    EdiThresholds thresholds;
    double size_error = 0;
    double ratio_error = 0;
};

/// Thresholds belong to the sensor, not to a frame, so those of a recording's frames should agree:
/// a running value over one frame after the other, from the frames up to then alone.
///
/// A frame with too few events to tell (its size known no better than to 15 %) leaves the value as
/// it is; before there is any, such a frame gets its own estimate. From the first telling frame on
/// each gets the median of the last 9 telling ones, weighted by their errors. The first frame is
/// thus treated as it would be alone. After 9 of them only every 32nd frame is estimated, in case
/// the sensor's bias was changed; while the latest estimate lies more than 20 % from the median,
/// the next frame is estimated too, so that an outlier costs little and a change takes hold after
/// five of them. Frames of another sensor need another track.
class EdiThresholdTrack {
public:
    /// Thresholds for the next frame; calls `estimate` where it needs that frame's own.
    EdiThresholds next(const std::function<EdiEstimate()>& estimate);

private:
    [[nodiscard]] EdiThresholds median() const;

    std::vector<EdiEstimate> told_; ///< by telling frames, the oldest first
    size_t rest_ = 0;               ///< frames until the next estimation
};

} // namespace ecir
