#include <Eigen/Core>
#include <algorithm>
#include <string>

#include "layers/conv.hpp"
#include "layers/shapes.hpp"
#include "runtime/error.hpp"

// Where the weights of a convolution go: the order in which the kernels read them.

namespace ecir {
namespace {

[[noreturn]] void fail(const std::string& what) {
    throw Error(ExitCode::device, "conv: " + what);
}

/// So that what comes next can be bound when a value takes `bytes`.
void append_aligned(std::vector<float>& all, const std::vector<float>& part,
                    size_t bytes = sizeof(float)) {
    all.insert(all.end(), part.begin(), part.end());
    const size_t values = kBindingAlignment / bytes;
    all.resize((all.size() + values - 1) / values * values);
}

/// Input channels of one slice: enough work for each pass over the output, code that still compiles
/// fast.
uint32_t slice_channels(uint32_t taps) {
    constexpr uint32_t kMostTaps = 144; // of all channels: half a second of LLVM for 40 pixels
    return std::max(kConvTileBlock, kMostTaps / taps / kConvTileBlock * kConvTileBlock);
}

} // namespace

Conv::Conv(Device& device, const ConvDesc& desc, const std::vector<ChannelMap>& inputs,
           std::span<const float> weight, std::span<const float> bias,
           std::optional<ConvFamily> family)
    : device_(device), desc_(desc), inputs_(inputs),
      family_(family.value_or(conv_family(device.info()))),
      block_(family_ == ConvFamily::row    ? 1
             : family_ == ConvFamily::lane ? channel_block(device.info())
                                           : kConvTileBlock),
      precision_(desc.precision.value_or(device.precision())) {
    for (const ChannelMap& map : inputs) {
        in_channels_ += static_cast<uint32_t>(map.size());
    }
    const size_t wanted = size_t{desc.out_channels} * in_channels_ * desc.kernel * desc.kernel;
    if (weight.size() != wanted || (!bias.empty() && bias.size() != desc.out_channels)) {
        fail("weight has " + std::to_string(weight.size()) + " values, the shape needs " +
             std::to_string(wanted));
    }
    if (desc.most_bound % block_ != 0) {
        fail("most_bound is " + std::to_string(desc.most_bound) + ", not a multiple of the block " +
             std::to_string(block_));
    }
    if (precision_ == Precision::float16 &&
        (family_ != ConvFamily::tile || !has_float16(device.info()))) {
        check_precision(device.info(), precision_);
    }
    matrices_ = precision_ == Precision::float16 &&
                desc.matrices.value_or(use_matrices(device.info(), desc.out_channels));
    if (family_ == ConvFamily::row) {
        if (desc.out_channels % kConvRowGroup != 0) {
            fail("the row family does not take " + std::to_string(desc.out_channels) +
                 " output channels");
        }
        pack_row(weight, bias);
        return;
    }
    make_phases();
    std::vector<float> padded(zeros_offset() / sizeof(float) + size_t{groups()} * block_);
    std::ranges::copy(bias, padded.begin());
    bias_ = upload<float>(device, padded);
    if (family_ == ConvFamily::lane) {
        pack_lane(weight);
    } else {
        pack_tile(weight);
    }
}

void Conv::make_phases() {
    const uint32_t k = desc_.kernel;
    if ((k != 1 && k != 3 && k != 5) || (desc_.stride != 1 && desc_.stride != 2) ||
        (desc_.transposed && (desc_.stride != 2 || k == 1))) {
        fail("kernel " + std::to_string(k) + " with stride " + std::to_string(desc_.stride) +
             " is not supported");
    }
    if (!desc_.transposed) {
        Phase phase{k, k, k / 2, k / 2, 0, 0, {}};
        for (uint32_t tap = 0; tap < k * k; ++tap) {
            phase.taps.push_back(tap);
        }
        phases_.push_back(phase);
        return;
    }
    // out[2 j + p] = sum over ky = p + pad (mod 2) of w[ky] in[j + (p + pad - ky) / 2]: in the
    // order of the input rows ky falls, from the largest of its parity.
    struct Axis {
        std::vector<uint32_t> taps;
        uint32_t pad;
    };
    const int pad = static_cast<int>(k / 2);
    const auto axis = [&](int p) {
        Axis result{{}, 0};
        for (int ky = static_cast<int>(k) - 1; ky >= 0; --ky) {
            if ((p + pad - ky) % 2 == 0) {
                if (result.taps.empty()) {
                    result.pad = static_cast<uint32_t>((ky - p - pad) / 2);
                }
                result.taps.push_back(static_cast<uint32_t>(ky));
            }
        }
        return result;
    };
    for (const uint32_t py : {0U, 1U}) {
        for (const uint32_t px : {0U, 1U}) {
            const Axis rows = axis(static_cast<int>(py));
            const Axis columns = axis(static_cast<int>(px));
            Phase phase{static_cast<uint32_t>(rows.taps.size()),
                        static_cast<uint32_t>(columns.taps.size()),
                        rows.pad,
                        columns.pad,
                        py,
                        px,
                        {}};
            for (const uint32_t ky : rows.taps) {
                for (const uint32_t kx : columns.taps) {
                    phase.taps.push_back(ky * k + kx);
                }
            }
            phases_.push_back(phase);
        }
    }
}

float Conv::weight_at(std::span<const float> weight, uint32_t out, uint32_t in,
                      uint32_t tap) const {
    if (out >= desc_.out_channels) {
        return 0;
    }
    const size_t taps = size_t{desc_.kernel} * desc_.kernel;
    const size_t pair =
        desc_.transposed ? size_t{in} * desc_.out_channels + out : size_t{out} * in_channels_ + in;
    return weight[pair * taps + tap];
}

void Conv::pack_lane(std::span<const float> weight) {
    std::vector<float> all;
    for (const Phase& phase : phases_) {
        const auto taps = static_cast<uint32_t>(phase.taps.size());
        std::vector<Slice> slices;
        for (uint32_t input = 0; input < inputs_.size(); ++input) {
            const auto channels = static_cast<uint32_t>(inputs_[input].size());
            const uint32_t cap = slice_channels(taps);
            for (uint32_t first = 0; first < channels;) {
                // A few channels go in one exact slice, so that a layer with 1 or 9 wastes nothing.
                const uint32_t rest = channels - first;
                const uint32_t count = first == 0 && channels <= 10
                                           ? channels
                                           : std::min(cap, round_up(rest, kConvTileBlock));
                const uint32_t pairs = (count * taps + 1) / 2;
                const uint64_t group_bytes = uint64_t{pairs} * block_ * 8;
                Slice slice{input, first, count, {}, 0};
                slice.groups_per_chunk =
                    std::min(groups(), static_cast<uint32_t>(kConvUniformSlice / group_bytes));
                if (desc_.most_bound != 0) {
                    slice.groups_per_chunk =
                        std::min(slice.groups_per_chunk, desc_.most_bound / block_);
                }
                for (uint32_t group = 0; group < groups(); group += slice.groups_per_chunk) {
                    const uint32_t end = std::min(groups(), group + slice.groups_per_chunk);
                    std::vector<float> chunk(size_t{end - group} * pairs * block_ * 2);
                    for (uint32_t g = group; g < end; ++g) {
                        for (uint32_t i = 0; i < std::min(count, rest); ++i) {
                            for (uint32_t t = 0; t < taps; ++t) {
                                const uint32_t n = i * taps + t;
                                for (uint32_t lane = 0; lane < block_; ++lane) {
                                    const size_t at =
                                        ((size_t{g - group} * pairs + n / 2) * block_ + lane) * 2 +
                                        n % 2;
                                    chunk[at] = weight_at(weight, g * block_ + lane,
                                                          inputs_[input][first + i], phase.taps[t]);
                                }
                            }
                        }
                    }
                    slice.offsets.push_back(all.size() * sizeof(float));
                    append_aligned(all, chunk);
                }
                slices.push_back(std::move(slice));
                first += count;
            }
        }
        slices_.push_back(std::move(slices));
    }
    all.resize(all.size() +
               kConvUniformSlice / sizeof(float)); // the last binding is as long as the others
    weights_ = upload<float>(device_, all);
}

void Conv::pack_tile(std::span<const float> weight) {
    // [O/across][I/deep][taps][deep][across]: conv_tile.glsl takes channels one by one.
    const uint32_t across = matrices_ ? device_.info().matrices.n : block_;
    const uint32_t deep = matrices_ ? device_.info().matrices.k : 1;
    const uint32_t outs =
        round_up(desc_.out_channels, matrices_ ? across * matrices_across() : across);
    const size_t bytes = precision_ == Precision::float16 ? sizeof(Eigen::half) : sizeof(float);
    std::vector<float> all;
    for (const Phase& phase : phases_) {
        const auto taps = static_cast<uint32_t>(phase.taps.size());
        std::vector<uint64_t> offsets;
        for (const ChannelMap& map : inputs_) {
            const auto channels = static_cast<uint32_t>(map.size());
            const uint32_t padded = round_up(channels, std::max(deep, kConvTileBlock));
            std::vector<float> part(size_t{outs} * padded * taps);
            for (uint32_t out = 0; out < desc_.out_channels; ++out) {
                for (uint32_t in = 0; in < channels; ++in) {
                    for (uint32_t t = 0; t < taps; ++t) {
                        const size_t slice = size_t{out / across} * (padded / deep) + in / deep;
                        const size_t row = (slice * taps + t) * deep + in % deep;
                        part[row * across + out % across] =
                            weight_at(weight, out, map[in], phase.taps[t]);
                    }
                }
            }
            offsets.push_back(all.size() * bytes);
            append_aligned(all, part, bytes);
        }
        tile_offsets_.push_back(std::move(offsets));
    }
    if (precision_ == Precision::float16) {
        const std::vector<Eigen::half> rounded(all.begin(), all.end());
        weights_ = upload<Eigen::half>(device_, rounded);
    } else {
        weights_ = upload<float>(device_, all);
    }
}

} // namespace ecir
