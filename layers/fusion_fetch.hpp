#pragma once
#include <array>

#include "layers/motion.hpp"

namespace ecir {

/// Records the differences between the anchors fetched along `away` and the prior at the instant,
/// nearest in time first: channels 2 to 10 of `planes`, of which channel 0 must be there.
/// anchors  PriorExposure::anchors of block 1
/// away     from record_trajectory(); finite
/// instant  one channel of instant_layout()
/// planes   see record_prior_frame()
/// Throws Error(bad_input) for shapes that do not match; finish() throws Error(resources) when a
/// tensor exceeds what the device can bind (as record_reference_fetch()).
void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes);

/// Frames at the first, the middle and the last anchor, which those of all other times are compared
/// with (layers/agreement.hpp).
inline constexpr uint32_t reference_count = 3;
inline constexpr std::array<double, reference_count> reference_times = {-1, 0, 1};

/// Records the differences between such frames, fetched along `away`, and the one at the instant.
/// references   reference_count channels, block 1
/// frame        1 channel, block 1, of the same size
/// differences  reference_count channels, dense
void record_reference_fetch(Program& program, const Tensor& references, const Tensor& away,
                            const Tensor& instant, const Tensor& frame, const Tensor& differences);

} // namespace ecir
