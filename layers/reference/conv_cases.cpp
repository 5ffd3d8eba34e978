#include "layers/reference/conv_cases.hpp"

#include <algorithm>
#include <array>
#include <string>

#include "layers/deblur.hpp"
#include "layers/ecir.hpp"
#include "layers/fusion.hpp"
#include "layers/model_family.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

constexpr uint32_t kHeight = 180;
constexpr uint32_t kWidth = 240;

/// Collects convolutions at sizes divided by 1, 2, 4, ...: that of the input, or of the output of a
/// transposed one. Each once.
class Collector {
public:
    void add(uint32_t divisor, ConvCase conv) {
        conv.height = (kHeight + divisor - 1) / divisor;
        conv.width = (kWidth + divisor - 1) / divisor;
        if (std::ranges::find(convs_, conv) == convs_.end()) {
            convs_.push_back(std::move(conv));
        }
    }
    void plain(uint32_t divisor, uint32_t channels) {
        add(divisor, {.inputs = {channels}, .out = channels, .residual = true});
    }
    void down(uint32_t divisor, uint32_t in, uint32_t out, uint32_t kernel, bool residual = false) {
        add(divisor,
            {.kernel = kernel, .stride = 2, .inputs = {in}, .out = out, .residual = residual});
    }
    void up(uint32_t divisor, const std::vector<uint32_t>& inputs, uint32_t out, uint32_t kernel,
            bool residual) {
        add(divisor, {.kernel = kernel,
                      .stride = 2,
                      .transposed = true,
                      .inputs = inputs,
                      .out = out,
                      .bias = residual, // fusion's have both, those of ecir neither
                      .residual = residual});
    }
    [[nodiscard]] std::vector<ConvCase> convs() const { return convs_; }

private:
    std::vector<ConvCase> convs_;
};

void collect_fusion(Collector& add, const FusionWidths& widths) {
    const auto [a, b, c, d] = widths.trunk;
    add.add(1, {.stride = 2, .inputs = {anchor_count, anchor_count}, .out = a, .planar = 2});
    add.down(2, a, b, 3);
    add.plain(4, b);
    add.down(4, b, c, 3, true);
    add.add(8, {.inputs = {2 * anchor_count}, .out = c, .bias = false, .relu = false});
    add.plain(8, c);
    add.down(8, c, d, 3);
    add.plain(16, d);
    add.up(8, {d}, c, 3, true);
    add.up(4, {c}, b, 3, true);
    const auto [x, y, z] = widths.head;
    add.add(4, {.inputs = {b}, .out = fusion_basis * z, .relu = false});
    add.add(1, {.kernel = 5, .stride = 2, .inputs = {plane_count}, .out = y, .planar = 1});
    add.down(2, y, z, 3, true);
    add.plain(4, z);
    add.up(2, {z}, y, 3, true);
    add.plain(2, y);
    add.add(1, {.stride = 2, .transposed = true, .inputs = {y}, .out = x, .relu = false});
}

void collect_ecir(Collector& add) {
    const SafeTensors weights(find_model("ecir"));
    const auto width = [&](const std::string& name, size_t axis) {
        return weights.get(name + ".0.weight").shape.at(axis);
    };
    const std::array encoder = {width("unet.en_conv1", 0), width("unet.en_conv2", 0),
                                width("unet.en_conv3", 0), width("unet.en_conv4", 0)};
    const std::array decoder = {width("unet.de_conv1", 1), width("unet.de_conv2", 1),
                                width("unet.de_conv3", 1), width("unet.de_conv4", 1)};
    const EcirConfig config(weights);
    add.add(1, {.kernel = 5,
                .stride = 2,
                .inputs = {1, config.bins, config.keypoints},
                .out = encoder[0],
                .planar = 1});
    for (size_t i = 1; i < encoder.size(); ++i) {
        add.down(1U << i, encoder.at(i - 1), encoder.at(i), 5);
    }
    add.plain(16, encoder[3]);
    add.up(8, {encoder[3]}, decoder[0], 5, false);
    for (size_t i = 1; i < decoder.size(); ++i) {
        add.up(8U >> i, {decoder.at(i - 1), encoder.at(3 - i)}, decoder.at(i), 5, false);
    }
    add.add(1, {.kernel = 1,
                .inputs = {1, decoder[3], config.bins, config.keypoints},
                .out = round_up(config.keypoints, kConvRowGroup),
                .relu = false,
                .planar = 1});
}

} // namespace

const std::vector<ConvCase>& small_convs() {
    static const std::vector<ConvCase> all = {
        {3, 1, false, {3}, 5, 7, 9, true, true, false, 0},
        {3, 1, false, {9}, 32, 6, 43, false, true, false, 0},
        {3, 1, false, {40}, 24, 5, 17, true, true, true, 0},
        {3, 1, false, {1}, 32, 9, 31, false, true, false, 1},
        {3, 1, false, {16}, 264, 3, 5, true, false, true, 0},
        {3, 2, false, {20}, 12, 1, 1, true, false, false, 0},
        {3, 2, false, {8}, 8, 13, 11, false, false, true, 0},
        {5, 2, false, {40, 11}, 16, 11, 43, true, true, false, 0},
        {5, 2, false, {24}, 80, 8, 22, true, true, false, 0},
        {5, 1, false, {8, 3}, 9, 6, 21, true, false, false, 0},
        {1, 1, false, {32, 40, 11}, 10, 5, 23, true, false, false, 0},
        {1, 1, false, {5}, 3, 1, 1, true, true, false, 0},
        {1, 2, false, {8}, 8, 5, 6, false, false, false, 0},
        {5, 2, true, {24, 24}, 16, 9, 43, false, true, false, 0},
        {5, 2, true, {12}, 7, 10, 12, false, false, false, 0},
        {5, 2, true, {8}, 8, 1, 1, true, true, false, 0},
        {3, 2, true, {8}, 8, 7, 6, true, false, true, 0},
    };
    return all;
}

const std::vector<ConvCase>& small_row_convs() {
    static const std::vector<ConvCase> all = {
        {3, 1, false, {9}, 32, 6, 43, true, true, false},
        {3, 1, false, {3}, 4, 7, 9, false, true, true},
        {3, 1, false, {40, 24}, 12, 5, 17, true, true, true},
        {3, 1, false, {1}, 8, 1, 1, true, false, false},
        {3, 1, false, {70}, 8, 3, 8, true, true, true, 1},
        {3, 2, false, {20}, 12, 1, 1, true, false, false},
        {3, 2, false, {8}, 8, 13, 11, false, false, true},
        {3, 2, false, {5, 60}, 4, 6, 34, true, true, true, 1},
        {5, 2, false, {24}, 8, 11, 43, true, true, false},
        {5, 2, false, {7}, 16, 8, 22, false, true, true},
        {3, 2, true, {8}, 8, 7, 6, true, false, true},
        {3, 2, true, {34, 60}, 12, 9, 43, false, true, false},
        {3, 2, true, {16}, 4, 1, 1, true, true, true, 1},
        {5, 2, true, {12}, 8, 10, 12, false, false, false},
        {5, 2, true, {33}, 4, 5, 21, true, true, true},
        {1, 1, false, {32, 40, 11}, 12, 5, 23, true, false, false},
        {1, 1, false, {5}, 8, 1, 1, false, true, true, 1},
    };
    return all;
}

std::vector<ConvCase> network_convs() {
    Collector collector;
    std::vector<ModelFamily::Member> members = ModelFamily::shipped().members();
    std::ranges::reverse(members);
    for (const ModelFamily::Member& member : members) {
        collect_fusion(collector, FusionWidths(SafeTensors(find_model(member.model))));
    }
    collect_ecir(collector);
    return collector.convs();
}

} // namespace ecir
