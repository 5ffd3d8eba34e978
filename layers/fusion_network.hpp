#pragma once
#include <array>
#include <map>
#include <span>
#include <string>

#include "layers/conv_pair.hpp"
#include "layers/fusion_mix.hpp"
#include "layers/prior.hpp"
#include "weights/safetensors.hpp"

namespace ecir {

/// Channels of the fusion network (tools/train/fusion.py), from the metadata `trunk` and `head` of
/// a weights file.
struct FusionWidths {
    std::array<uint32_t, 4> trunk{}; ///< at 1/2, 1/4, 1/8 and 1/16 of the size
    std::array<uint32_t, 3> head{};  ///< at the full size, at 1/2 and 1/4

    /// Throws Error(bad_input) for metadata that is missing or out of range.
    explicit FusionWidths(const SafeTensors& weights);
};

/// Convolutions by their names in a weights file, without the prefix.
using ConvTable = std::map<std::string, Conv>;

/// Once an exposure: features for the head.
class FusionTrunk {
public:
    FusionTrunk(Device& device, const SafeTensors& weights, const FusionWidths& widths);

    /// Layouts of record_prior()'s anchors and context, and of record_motion()'s channels, whose
    /// halos are zeros.
    [[nodiscard]] Layout exposure_layout(const DeviceInfo& info, uint32_t height,
                                         uint32_t width) const;
    [[nodiscard]] Layout velocity_layout(const DeviceInfo& info, uint32_t height,
                                         uint32_t width) const;

    /// Returns the features, fusion_basis_layout() of the head's last width at a quarter of the
    /// size. What fills up the last block of `velocity` must be finite.
    Tensor record(Program& program, const PriorExposure& exposure, const Tensor& velocity) const;

private:
    FusionWidths widths_;
    ConvFamily family_;
    ConvTable convs_;
};

/// Once a wanted time: the prior, corrected.
class FusionHead {
public:
    FusionHead(Device& device, const SafeTensors& weights, const FusionWidths& widths);

    /// Tensors of one frame, which others can use after it.
    struct Tensors {
        Tensor planes, mixed, x0, between, x1, inner1, x2, inner2;
    };
    Tensors prepare(Program& program, uint32_t height, uint32_t width) const;

    /// From t.planes and t.mixed to the frame, 1 channel, block 1.
    void record(Program& program, const Tensors& t, const Tensor& frame) const;

private:
    FusionWidths widths_;
    ConvFamily family_;
    ConvTable convs_;
    ConvPair end_;
};

} // namespace ecir
