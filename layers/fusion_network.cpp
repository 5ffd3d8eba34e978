#include "layers/fusion_network.hpp"

#include <algorithm>
#include <charconv>

#include "layers/motion.hpp"
#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"
#include "runtime/error.hpp"

namespace ecir {
namespace {

constexpr uint32_t kMostChannels = 1024;
constexpr uint32_t kPlaneHalo = 2; ///< of the head's input: its first convolution is 5x5

/// The numbers in a metadata entry, as many as `widths` has, divided by spaces.
void read_widths(const SafeTensors& weights, const std::string& key, std::span<uint32_t> widths) {
    const std::string text = weights.meta(key);
    const char* at = text.data();
    const char* const end = at + text.size();
    bool good = true;
    for (uint32_t& width : widths) {
        at = std::find_if(at, end, [](char c) { return c != ' '; });
        const auto [stop, error] = std::from_chars(at, end, width);
        good = good && error == std::errc{} && width >= 1 && width <= kMostChannels;
        at = stop;
    }
    if (!good || at != end) {
        throw Error(ExitCode::bad_input, "weights file " + weights.path().string() +
                                             ": metadata '" + key + "' is '" + text +
                                             "'; it must be " + std::to_string(widths.size()) +
                                             " numbers from 1 to " + std::to_string(kMostChannels));
    }
}

/// One family for the whole network: parts hand their tensors to one another.
ConvFamily network_family(const DeviceInfo& info, const FusionWidths& widths) {
    std::vector<uint32_t> channels(widths.trunk.begin(), widths.trunk.end());
    channels.insert(channels.end(), widths.head.begin(), widths.head.end());
    return row_family(info, channels);
}

/// The mixed features, dense, at a quarter of the size.
Layout mixed_layout(const DeviceInfo& info, ConvFamily family, uint32_t channels, uint32_t height,
                    uint32_t width) {
    return {channels, ceil_div(height, 4), ceil_div(width, 4),
            family == ConvFamily::row ? 1 : channel_block(info)};
}

/// Makes convolutions from the tensors `fusion.*` of a weights file, into a table.
struct Loader {
    Device& device;
    const SafeTensors& weights;
    ConvTable& table;
    ConvFamily family;

    [[nodiscard]] const std::vector<float>& get(const std::string& name,
                                                const std::vector<uint32_t>& shape) const {
        return weights.get("fusion." + name, shape);
    }
    /// inputs: channels of each input tensor.
    void add(const std::string& name, const std::vector<uint32_t>& inputs, const ConvDesc& desc,
             bool has_bias = true) {
        std::vector<ChannelMap> maps;
        uint32_t in = 0;
        for (const uint32_t channels : inputs) {
            maps.push_back(channel_range(in, channels));
            in += channels;
        }
        const uint32_t out = desc.out_channels;
        const auto& weight =
            get(name + ".weight",
                {desc.transposed ? in : out, desc.transposed ? out : in, desc.kernel, desc.kernel});
        std::span<const float> bias;
        if (has_bias) {
            bias = get(name + ".bias", {out});
        }
        table.emplace(name, Conv(device, desc, maps, weight, bias, family));
    }
    void down(const std::string& name, const std::vector<uint32_t>& inputs, uint32_t out,
              uint32_t kernel = 3) {
        add(name, inputs, {.out_channels = out, .kernel = kernel, .stride = 2, .relu = true});
    }
    void up(const std::string& name, uint32_t in, uint32_t out) {
        add(name + ".conv", {in},
            {.out_channels = out, .stride = 2, .transposed = true, .relu = true});
    }
    void residual(const std::string& name, uint32_t channels) {
        for (const char* part : {".a", ".b"}) {
            add(name + part, {channels}, {.out_channels = channels, .relu = true});
        }
    }
    /// To the coefficients of the head's features, each set filled up to whole blocks.
    void basis(const std::string& name, uint32_t in, uint32_t channels) {
        const std::vector<float>& weight =
            get(name + ".weight", {fusion_basis * channels, in, 3, 3});
        const std::vector<float>& bias = get(name + ".bias", {fusion_basis * channels});
        const uint32_t padded =
            padded_channels(mixed_layout(device.info(), family, channels, 1, 1));
        const size_t row = size_t{in} * 9;
        std::vector<float> weights_padded(size_t{fusion_basis} * padded * row);
        std::vector<float> bias_padded(size_t{fusion_basis} * padded);
        for (size_t c = 0; c < bias.size(); ++c) {
            const size_t to = c / channels * padded + c % channels;
            std::copy_n(weight.begin() + static_cast<ptrdiff_t>(c * row), row,
                        weights_padded.begin() + static_cast<ptrdiff_t>(to * row));
            bias_padded[to] = bias[c];
        }
        table.emplace(name, Conv(device, {.out_channels = fusion_basis * padded},
                                 {channel_range(0, in)}, weights_padded, bias_padded, family));
    }
};

/// relu(x + b(relu(a(x)))) in place; `inner` has the layout of x.
void record_residual(Program& program, const ConvTable& convs, const std::string& name,
                     const Tensor& x, const Tensor& inner) {
    convs.at(name + ".a").record(program, x, inner);
    convs.at(name + ".b").record(program, inner, x, x);
}

} // namespace

FusionWidths::FusionWidths(const SafeTensors& weights) {
    read_widths(weights, "trunk", trunk);
    read_widths(weights, "head", head);
}

FusionTrunk::FusionTrunk(Device& device, const SafeTensors& weights, const FusionWidths& widths)
    : widths_(widths), family_(network_family(device.info(), widths)) {
    const auto [a, b, c, d] = widths.trunk;
    Loader load{device, weights, convs_, family_};
    load.down("trunk.down1", {anchor_count, anchor_count}, a); // anchors; blurry frame and counts
    load.down("trunk.down2", {a}, b);
    load.residual("trunk.res2", b);
    load.down("trunk.down3", {b}, c);
    load.add("trunk.motion", {2 * anchor_count}, {.out_channels = c}, false);
    load.residual("trunk.res3", c);
    load.down("trunk.down4", {c}, d);
    load.residual("trunk.res4", d);
    load.residual("trunk.res5", d);
    load.up("trunk.up3", d, c);
    load.residual("trunk.res6", c);
    load.up("trunk.up2", c, b);
    load.residual("trunk.res7", b);
    load.basis("trunk.feature", b, widths.head[2]);
}

Layout FusionTrunk::exposure_layout(const DeviceInfo& info, uint32_t height, uint32_t width) const {
    return image_layout(info, family_, anchor_count, height, width, 1);
}

Layout FusionTrunk::velocity_layout(const DeviceInfo& info, uint32_t height, uint32_t width) const {
    return conv_layout(info, family_, 2 * anchor_count, ceil_div(height, 8), ceil_div(width, 8), 1);
}

Tensor FusionTrunk::record(Program& program, const PriorExposure& exposure,
                           const Tensor& velocity) const {
    const auto [a, b, c, d] = widths_.trunk;
    const uint32_t height = exposure.anchors.layout().height;
    const uint32_t width = exposure.anchors.layout().width;
    const DeviceInfo& info = program.device().info();
    const auto zeroed = [&](uint32_t channels, uint32_t divisor) {
        return program.cleared(conv_layout(info, family_, channels, ceil_div(height, divisor),
                                           ceil_div(width, divisor), 1));
    };
    const auto conv = [&](const char* name) -> const Conv& {
        return convs_.at(std::string("trunk.") + name);
    };
    const auto residual = [&](const char* name, const Tensor& x, const Tensor& inner) {
        record_residual(program, convs_, std::string("trunk.") + name, x, inner);
    };
    const Tensor x1 = zeroed(a, 2);
    const Tensor x2 = zeroed(b, 4);
    const Tensor inner2 = zeroed(b, 4);
    const Tensor x3 = zeroed(c, 8);
    const Tensor inner3 = zeroed(c, 8);
    const Tensor x4 = zeroed(d, 16);
    const Tensor inner4 = zeroed(d, 16);

    const std::array inputs = {exposure.anchors, exposure.context};
    conv("down1").record(program, inputs, x1);
    conv("down2").record(program, x1, x2);
    residual("res2", x2, inner2);
    conv("motion").record(program, velocity, x3);
    conv("down3").record(program, x2, x3, x3);
    residual("res3", x3, inner3);
    conv("down4").record(program, x3, x4);
    residual("res4", x4, inner4);
    residual("res5", x4, inner4);
    conv("up3.conv").record(program, x4, x3, x3);
    residual("res6", x3, inner3);
    conv("up2.conv").record(program, x3, x2, x2);
    residual("res7", x2, inner2);
    const Tensor features = program.temporary(
        fusion_basis_layout(mixed_layout(info, family_, widths_.head[2], height, width)));
    conv("feature").record(program, x2, features);
    return features;
}

FusionHead::FusionHead(Device& device, const SafeTensors& weights, const FusionWidths& widths)
    : widths_(widths), family_(network_family(device.info(), widths)),
      end_(device, plane_count, widths.head[0],
           weights.get("fusion.head.skip.weight", {widths.head[0], plane_count, 3, 3}),
           weights.get("fusion.head.out.weight", {1, widths.head[0], 3, 3}),
           weights.get("fusion.head.out.bias", {1}).front()) {
    const auto [a, b, c] = widths.head;
    Loader load{device, weights, convs_, family_};
    load.down("head.down1", {plane_count}, b, 5);
    load.down("head.down2", {b}, c);
    load.residual("head.res2", c);
    load.residual("head.res3", c);
    load.up("head.up1", c, b);
    load.residual("head.res1", b);
    load.add("head.up0.conv", {b}, {.out_channels = a, .stride = 2, .transposed = true});
}

FusionHead::Tensors FusionHead::prepare(Program& program, uint32_t height, uint32_t width) const {
    const auto [a, b, c] = widths_.head;
    const DeviceInfo& info = program.device().info();
    const auto at = [&](uint32_t channels, uint32_t divisor, uint32_t halo) {
        return conv_layout(info, family_, channels, ceil_div(height, divisor),
                           ceil_div(width, divisor), halo);
    };
    Tensors t;
    t.planes = program.cleared(image_layout(info, family_, plane_count, height, width, kPlaneHalo));
    t.mixed = program.temporary(mixed_layout(info, family_, c, height, width));
    t.x0 = program.temporary(at(a, 1, 0));
    t.between = ConvPair::scratch(program, a, height, width);
    t.x1 = program.cleared(at(b, 2, 1));
    t.inner1 = program.cleared(at(b, 2, 1));
    t.x2 = program.cleared(at(c, 4, 1));
    t.inner2 = program.cleared(at(c, 4, 1));
    return t;
}

void FusionHead::record(Program& program, const Tensors& t, const Tensor& frame) const {
    convs_.at("head.down1").record(program, t.planes, t.x1);
    convs_.at("head.down2").record(program, t.x1, t.x2, t.mixed);
    record_residual(program, convs_, "head.res2", t.x2, t.inner2);
    record_residual(program, convs_, "head.res3", t.x2, t.inner2);
    convs_.at("head.up1.conv").record(program, t.x2, t.x1, t.x1);
    record_residual(program, convs_, "head.res1", t.x1, t.inner1);
    convs_.at("head.up0.conv").record(program, t.x1, t.x0);
    // relu(up0 + skip(planes)), then the output; channel 0 is the prior.
    end_.record(program, t.planes, t.between, frame,
                {.start = t.x0, .added = t.planes.channels(0, 1)});
}

} // namespace ecir
