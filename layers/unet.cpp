#include "layers/unet.hpp"

#include <algorithm>
#include <cmath>

#include "layers/shapes.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

constexpr double kBatchNormEpsilon = 1e-5;

/// A 3x3 convolution without bias and the batch norm after it as one convolution with bias.
Conv folded(Device& device, const SafeTensors& weights, const std::string& conv,
            const std::string& norm, uint32_t channels, ConvFamily family) {
    std::vector<float> weight = weights.get(conv + ".weight", {channels, channels, 3, 3});
    const auto& gain = weights.get(norm + ".weight", {channels});
    const auto& shift = weights.get(norm + ".bias", {channels});
    const auto& mean = weights.get(norm + ".running_mean", {channels});
    const auto& variance = weights.get(norm + ".running_var", {channels});
    std::vector<float> bias(channels);
    const size_t per_channel = weight.size() / channels;
    for (uint32_t c = 0; c < channels; ++c) {
        const double scale = gain[c] / std::sqrt(double{variance[c]} + kBatchNormEpsilon);
        bias[c] = static_cast<float>(shift[c] - mean[c] * scale);
        for (size_t i = 0; i < per_channel; ++i) {
            float& value = weight[c * per_channel + i];
            value = static_cast<float>(value * scale);
        }
    }
    return {device,
            {.out_channels = channels, .kernel = 3, .relu = true},
            {channel_range(0, channels)},
            weight,
            bias,
            family};
}

/// Output channels of a convolution, read from its weight.
uint32_t out_channels(const SafeTensors& weights, const std::string& name, size_t axis) {
    const auto& shape = weights.get(name).shape;
    if (shape.size() != 4 || shape[axis] == 0) {
        throw Error(ExitCode::bad_input, "weights file " + weights.path().string() + ": tensor '" +
                                             name + "' is not a convolution's weight");
    }
    return shape[axis];
}

} // namespace

UNet::ResidualBlock UNet::load_block(Device& device, const SafeTensors& weights,
                                     const std::string& name, uint32_t channels) const {
    return {folded(device, weights, name + ".0", name + ".1", channels, family_),
            folded(device, weights, name + ".3", name + ".4", channels, family_)};
}

ConvFamily UNet::family(const DeviceInfo& info, const SafeTensors& weights, uint32_t bins,
                        uint32_t height, uint32_t width) {
    std::vector<uint32_t> channels;
    for (const char* layer : {"1", "2", "3", "4"}) {
        const std::string number(layer);
        channels.push_back(out_channels(weights, "unet.en_conv" + number + ".0.weight", 0));
        channels.push_back(out_channels(weights, "unet.de_conv" + number + ".0.weight", 1));
    }
    const auto elements = [&](uint32_t count, uint32_t divisor) {
        return conv_layout(info, ConvFamily::row, count, ceil_div(height, divisor),
                           ceil_div(width, divisor), kInputHalo)
            .elements();
    };
    return row_family(
        info, channels,
        std::max(elements(std::max(bins, channels.back()), 1), elements(channels.front(), 2)));
}

UNet::UNet(Device& device, const SafeTensors& weights, uint32_t bins, uint32_t keypoints,
           ConvFamily family)
    : family_(family), keypoints_(keypoints) {
    const std::vector<ChannelMap> input = {channel_range(0, 1), channel_range(1, bins),
                                           channel_range(1 + bins, keypoints)};
    const uint32_t input_channels = 1 + bins + keypoints;

    uint32_t channels = input_channels;
    for (const char* layer : {"1", "2", "3", "4"}) {
        const std::string name = std::string("unet.en_conv") + layer + ".0";
        const uint32_t out = out_channels(weights, name + ".weight", 0);
        encoders_.emplace_back(
            device, ConvDesc{.out_channels = out, .kernel = 5, .stride = 2, .relu = true},
            encoders_.empty() ? input : std::vector<ChannelMap>{channel_range(0, channels)},
            weights.get(name + ".weight", {out, channels, 5, 5}),
            weights.get(name + ".bias", {out}), family);
        widths_.push_back(out);
        channels = out;
    }
    for (const char* name : {"unet.res1", "unet.res2"}) {
        blocks_.push_back(load_block(device, weights, name, channels));
    }
    for (const size_t level : {4U, 3U, 2U, 1U}) {
        const std::string name = "unet.de_conv" + std::to_string(5 - level) + ".0.weight";
        const uint32_t out = out_channels(weights, name, 1);
        // The deepest decoder sees the residual blocks alone, the others a skip connection too.
        const uint32_t skip = level == 4 ? 0 : widths_[level - 1];
        std::vector<ChannelMap> maps = {channel_range(0, channels)};
        if (skip > 0) {
            maps.push_back(channel_range(channels, skip));
        }
        decoders_.emplace_back(
            device,
            ConvDesc{
                .out_channels = out, .kernel = 5, .stride = 2, .transposed = true, .relu = true},
            maps, weights.get(name, {channels + skip, out, 5, 5}), std::span<const float>{},
            family);
        decoder_widths_.push_back(out);
        channels = out;
    }
    std::vector<ChannelMap> maps = {channel_range(0, channels)};
    uint32_t first = channels;
    for (const ChannelMap& map : input) {
        maps.push_back(channel_range(first, static_cast<uint32_t>(map.size())));
        first += static_cast<uint32_t>(map.size());
    }
    std::vector<float> weight =
        weights.get("unet.pred.weight", {keypoints, channels + input_channels, 1, 1});
    std::vector<float> bias = weights.get("unet.pred.bias", {keypoints});
    predicted_ = round_up(keypoints, kConvRowGroup);
    weight.resize(size_t{predicted_} * (channels + input_channels));
    bias.resize(predicted_);
    prediction_ = std::make_unique<Conv>(device, ConvDesc{.out_channels = predicted_, .kernel = 1},
                                         maps, weight, bias, family);
}

Tensor UNet::record(Program& program, const Tensor& blurry, const Tensor& histogram,
                    const Tensor& keypoints) const {
    const DeviceInfo& info = program.device().info();
    const Layout& image = blurry.layout();
    // Cleared, since a convolution reads the zeros around its input. Level: halvings of the image.
    const auto tensor = [&](uint32_t channels, size_t level, uint32_t halo) {
        const uint32_t divisor = 1U << level;
        const Layout layout = conv_layout(info, family_, channels, ceil_div(image.height, divisor),
                                          ceil_div(image.width, divisor), halo);
        return halo > 0 ? program.cleared(layout) : program.temporary(layout);
    };
    std::vector<Tensor> levels; // from the first halving on
    std::vector<Tensor> inputs = {blurry, histogram, keypoints};
    for (size_t i = 0; i < encoders_.size(); ++i) {
        levels.push_back(tensor(widths_[i], i + 1, 2));
        encoders_[i].record(program, inputs, levels.back());
        inputs = {levels.back()};
    }
    Tensor x = levels.back();
    for (const ResidualBlock& block_layers : blocks_) {
        const Tensor inner = tensor(widths_.back(), levels.size(), 1);
        const Tensor outer = tensor(widths_.back(), levels.size(), 1);
        block_layers.first.record(program, x, inner);
        block_layers.second.record(program, inner, outer, x);
        x = outer;
    }
    for (size_t i = 0; i < decoders_.size(); ++i) {
        const size_t level = decoders_.size() - i - 1; // of the output
        inputs = i == 0 ? std::vector{x} : std::vector{x, levels[level]};
        x = tensor(decoder_widths_[i], level, level == 0 ? 0 : 1);
        decoders_[i].record(program, inputs, x);
    }
    const Tensor derivatives = tensor(predicted_, 0, 0);
    const std::vector<Tensor> all = {x, blurry, histogram, keypoints};
    prediction_->record(program, all, derivatives);
    return derivatives.channels(0, keypoints_);
}

} // namespace ecir
