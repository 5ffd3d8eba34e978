#pragma once
#include "layers/conv_pair.hpp"
#include "layers/refine.hpp"
#include "weights/safetensors.hpp"

namespace ecir {

/// The refinement (algorithm 1 of the paper) from the tensors `refine.*` of a weights file:
/// recurrent residuals between neighbouring frames, gradient steps on equation 8, and a polish of
/// each frame.
class Refinement {
public:
    /// bounded: no step is over largest_refine_step(), so the descent cannot diverge whatever the
    /// weights (`paper`); else steps are as the network gives them (`release`). Throws
    /// Error(bad_input) naming the tensor that is missing or of a wrong shape.
    Refinement(Device& device, const SafeTensors& weights, bool bounded);

    /// initial: d frames in order of time, block 1, halo 1 (zeros); counts: 2 (d - 1) event counts
    /// between them, block 1, not looked at when d = 1; refined: d frames, block 1, its halo is not
    /// written. The iterations end early, which the device decides, after one that changed no pixel
    /// by as much as `settled`; those beyond the `trained` ones also after one whose largest change
    /// is not below that of the one before it, since they no longer converge. 0: never. Returns
    /// progress_layout(iterations), an output: the largest change of each iteration made and 0 of
    /// the others, then 1 for each made after the first and 0 for the others.
    Tensor record(Program& program, const Tensor& initial, const Tensor& counts,
                  const Tensor& refined, uint32_t iterations, uint32_t trained,
                  float settled) const;
    static Layout progress_layout(uint32_t iterations) { return {2 * iterations, 1, 1}; }

private:
    ConvPair first_residual_;
    ConvPair other_residual_;
    ConvPair polish_;
    AlphaWeights alpha_{};
    bool bounded_;
};

} // namespace ecir
