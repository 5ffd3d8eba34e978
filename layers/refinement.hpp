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
    /// written.
    void record(Program& program, const Tensor& initial, const Tensor& counts,
                const Tensor& refined, uint32_t iterations) const;

private:
    ConvPair first_residual_;
    ConvPair other_residual_;
    ConvPair polish_;
    AlphaWeights alpha_{};
    bool bounded_;
};

} // namespace ecir
