#pragma once
#include "layers/motion.hpp"

namespace ecir {

/// Records the differences between the anchors fetched along `away` and the prior at the instant,
/// nearest in time first: channels 2 to 10 of `planes`, of which channel 0 must be there.
/// anchors  PriorExposure::anchors of block 1
/// away     from record_trajectory(); finite
/// instant  one channel of instant_layout()
/// planes   see record_prior_frame()
/// Throws Error(bad_input) for shapes that do not match; finish() throws Error(resources) when
/// `anchors` or `planes` exceed what the device can bind.
void record_fusion_fetch(Program& program, const Tensor& anchors, const Tensor& away,
                         const Tensor& instant, const Tensor& planes);

} // namespace ecir
