#pragma once
#include "layers/conv_plane.hpp"

namespace ecir {

/// Two 3x3 convolutions with zero padding, ReLU between them, to one channel:
///     hidden = max(0, conv(input) + start),  output = conv(hidden) + bias + added.
/// The lane family does both in one kernel, without hidden channels in memory
/// (shaders/conv_pair.comp); else, and for more than kMostInputs input channels, a Conv and a
/// ConvPlane do.
class ConvPair {
public:
    static constexpr uint32_t kMostInputs = 32;

    /// first: [hidden][channels][3][3]; second: [1][hidden][3][3]. Throws Error(device) for sizes
    /// that disagree.
    ConvPair(Device& device, uint32_t channels, uint32_t hidden, std::span<const float> first,
             std::span<const float> second, float bias = 0);

    /// Memory between the kernels, which all pairs of a program that work on one size of image,
    /// with `hidden` channels at most, can use in turn.
    static Tensor scratch(Program& program, uint32_t hidden, uint32_t height, uint32_t width);

    [[nodiscard]] uint32_t hidden() const { return hidden_; }

    /// What goes into the sums.
    struct Terms {
        std::optional<Tensor> start; ///< hidden channels, block channel_block(), any halo, its
                                     ///< channel padding finite
        std::optional<Tensor> added; ///< 1 channel, block 1, any halo
    };
    /// input: block 1, a halo of at least 1 zeros; output: 1 channel, block 1, its halo is not
    /// written; scratch: of this size. All of one height and width, else throws Error(device).
    void record(Program& program, const Tensor& input, const Tensor& scratch, const Tensor& output,
                const Terms& terms = {}) const;

private:
    /// Hidden channels of one dispatch.
    struct Slice {
        uint32_t first;
        uint32_t count;
        uint64_t offset; ///< of its weights, bytes
    };
    struct Whole { ///< without the fused kernel
        Conv expand;
        ConvPlane project;
    };

    void pack(std::span<const float> first, std::span<const float> second);
    void check(const Tensor& input, const Tensor& scratch, const Tensor& output,
               const Terms& terms) const;
    void record_fused(Program& program, const Tensor& input, const Tensor& planes,
                      const std::optional<Tensor>& start) const;
    void record_sum(Program& program, const Tensor& planes, const Tensor& output,
                    const std::optional<Tensor>& added) const;

    Device& device_;
    uint32_t channels_;
    uint32_t hidden_;
    float bias_;
    std::optional<Whole> whole_;
    std::vector<Slice> slices_;
    std::shared_ptr<const Buffer> weights_;
};

} // namespace ecir
