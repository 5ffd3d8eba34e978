#include "layers/reference/conv.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <string>

#include "layers/conv.hpp"
#include "layers/conv_pair.hpp"
#include "layers/conv_plane.hpp"
#include "layers/reference/conv_cases.hpp"

namespace ecir::reference {

std::vector<double> conv(std::span<const double> in, uint32_t channels, uint32_t height,
                         uint32_t width, std::span<const float> weight, uint32_t out,
                         uint32_t kernel, uint32_t stride) {
    using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    const uint32_t out_height = (height + stride - 1) / stride;
    const uint32_t out_width = (width + stride - 1) / stride;
    const int pad = static_cast<int>(kernel / 2);
    // A column an output pixel, a row a tap.
    Matrix patches = Matrix::Zero(channels * kernel * kernel, out_height * out_width);
    for (uint32_t row = 0; row < patches.rows(); ++row) {
        const uint32_t channel = row / (kernel * kernel);
        const int ky = static_cast<int>(row / kernel % kernel) - pad;
        const int kx = static_cast<int>(row % kernel) - pad;
        for (uint32_t pixel = 0; pixel < patches.cols(); ++pixel) {
            const int y = static_cast<int>(pixel / out_width * stride) + ky;
            const int x = static_cast<int>(pixel % out_width * stride) + kx;
            if (y >= 0 && x >= 0 && y < static_cast<int>(height) && x < static_cast<int>(width)) {
                patches(row, pixel) =
                    in[(size_t{channel} * height + static_cast<size_t>(y)) * width +
                       static_cast<size_t>(x)];
            }
        }
    }
    const Eigen::Map<const Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> w(
        weight.data(), out, patches.rows());
    const Matrix product = w.cast<double>() * patches;
    return {product.data(), product.data() + product.size()};
}

std::vector<double> conv_transposed(std::span<const double> in, uint32_t channels, uint32_t height,
                                    uint32_t width, std::span<const float> weight, uint32_t out,
                                    uint32_t kernel, uint32_t out_height, uint32_t out_width) {
    const int pad = static_cast<int>(kernel / 2);
    std::vector<double> result(size_t{out} * out_height * out_width);
    for (uint32_t i = 0; i < channels; ++i) {
        for (uint32_t o = 0; o < out; ++o) {
            for (uint32_t y = 0; y < height; ++y) {
                for (uint32_t x = 0; x < width; ++x) {
                    for (uint32_t ky = 0; ky < kernel; ++ky) {
                        for (uint32_t kx = 0; kx < kernel; ++kx) {
                            const int oy = static_cast<int>(2 * y + ky) - pad;
                            const int ox = static_cast<int>(2 * x + kx) - pad;
                            if (oy < 0 || ox < 0 || oy >= static_cast<int>(out_height) ||
                                ox >= static_cast<int>(out_width)) {
                                continue;
                            }
                            const size_t tap = ((size_t{i} * out + o) * kernel + ky) * kernel + kx;
                            const size_t pixel =
                                (size_t{o} * out_height + static_cast<size_t>(oy)) * out_width +
                                static_cast<size_t>(ox);
                            result[pixel] +=
                                double{weight[tap]} * in[(size_t{i} * height + y) * width + x];
                        }
                    }
                }
            }
        }
    }
    return result;
}

} // namespace ecir::reference

namespace ecir {
namespace {

std::string describe(const ConvCase& c) {
    std::string inputs;
    for (const uint32_t channels : c.inputs) {
        inputs += (inputs.empty() ? "" : "+") + std::to_string(channels);
    }
    return std::to_string(c.kernel) + "x" + std::to_string(c.kernel) + " s" +
           std::to_string(c.stride) + (c.transposed ? " transposed " : " ") + inputs + "->" +
           std::to_string(c.out) + " " + std::to_string(c.width) + "x" + std::to_string(c.height);
}

Trial make_trial(Device& device, const ConvCase& c, CaseRandom random, ConvFamily family,
                 Precision precision = Precision::float32, uint32_t tile_rows = 0,
                 bool matrices = false) {
    Trial trial;
    trial.shape = describe(c);
    trial.program = std::make_unique<Program>(device);
    Program& program = *trial.program;

    const uint32_t block =
        family == ConvFamily::tile ? kConvTileBlock : channel_block(device.info());
    const uint32_t in_height = c.transposed ? (c.height + 1) / 2 : c.height;
    const uint32_t in_width = c.transposed ? (c.width + 1) / 2 : c.width;
    const uint32_t out_height = c.transposed ? c.height : (c.height + c.stride - 1) / c.stride;
    const uint32_t out_width = c.transposed ? c.width : (c.width + c.stride - 1) / c.stride;

    // The maps reverse the order of the tensors, so that they are seen to be followed.
    std::vector<ChannelMap> maps(c.inputs.size());
    uint32_t total = 0;
    for (size_t i = c.inputs.size(); i-- > 0;) {
        maps[i] = channel_range(total, c.inputs[i]);
        total += c.inputs[i];
    }
    const auto weight = random.values(size_t{total} * c.out * c.kernel * c.kernel, -0.5, 0.5);
    const auto bias = c.bias ? random.values(c.out, -1, 1) : std::vector<float>{};

    std::vector<double> all(size_t{total} * in_height * in_width);
    std::vector<Tensor> tensors;
    std::vector<std::vector<float>> memory;
    for (size_t i = 0; i < c.inputs.size(); ++i) {
        const Layout layout =
            family == ConvFamily::row
                ? conv_layout(device.info(), family, c.inputs[i], in_height, in_width, 2)
                : Layout{c.inputs[i], in_height, in_width, i < c.planar ? 1 : block, 2};
        const auto dense = random.values(size_t{c.inputs[i]} * in_height * in_width, -1, 1);
        std::ranges::copy(dense, all.begin() + static_cast<std::ptrdiff_t>(size_t{maps[i].front()} *
                                                                           in_height * in_width));
        tensors.push_back(program.input(layout));
        memory.push_back(from_dense(layout, dense));
    }
    Layout out_layout{c.out, out_height, out_width, block, 1};
    if (family == ConvFamily::row) {
        out_layout = conv_layout(device.info(), family, c.out, out_height, out_width, 1);
    }
    trial.output = program.output(out_layout);
    program.clear(trial.output);
    std::optional<Tensor> residual;
    std::vector<float> residual_dense;
    if (c.residual) {
        residual_dense = random.values(size_t{c.out} * out_height * out_width, -1, 1);
        // The row family takes any; by rows where inputs are not said to be planar.
        const Layout layout = family == ConvFamily::row && c.planar == 0
                                  ? conv_layout(device.info(), family, c.out, out_height, out_width)
                                  : Layout{c.out, out_height, out_width, block, 0};
        residual = program.input(layout);
    }
    trial.first_step = program.steps();
    const ConvDesc desc{.out_channels = c.out,
                        .kernel = c.kernel,
                        .stride = c.stride,
                        .transposed = c.transposed,
                        .relu = c.relu,
                        .precision = precision,
                        .tile_rows = tile_rows,
                        .matrices = matrices};
    const Conv layer(device, desc, maps, weight, bias, family);
    layer.record(program, tensors, trial.output, residual);
    program.finish();
    for (size_t i = 0; i < tensors.size(); ++i) {
        program.write(tensors[i], memory[i]);
    }
    if (residual) {
        program.write(*residual, from_dense(residual->layout(), residual_dense));
    }

    trial.reference =
        c.transposed
            ? reference::conv_transposed(all, total, in_height, in_width, weight, c.out, c.kernel,
                                         out_height, out_width)
            : reference::conv(all, total, in_height, in_width, weight, c.out, c.kernel, c.stride);
    for (size_t i = 0; i < trial.reference.size(); ++i) {
        double& value = trial.reference[i];
        value += c.bias ? bias[i / (size_t{out_height} * out_width)] : 0.0F;
        value += c.residual ? residual_dense[i] : 0.0F;
        value = c.relu ? std::max(value, 0.0) : value;
    }
    return trial;
}

Trial make_tile_trial(Device& device, uint32_t trial, Precision precision, bool matrices = false) {
    const auto small = static_cast<uint32_t>(small_convs().size());
    if (trial >= 2 * small) {
        // Of the networks' a few: where this is the device's family, `conv_row` has
        // all.
        constexpr std::array<size_t, 3> kChosen = {2, 9, 11};
        return make_trial(device, network_convs().at(kChosen.at(trial - 2 * small)),
                          CaseRandom(trial), ConvFamily::tile, precision, 0, matrices);
    }
    // Every case with two numbers of rows an invocation, which large images would choose.
    const ConvCase& conv = small_convs()[trial % small];
    constexpr std::array<uint32_t, 4> kRows = {8, 1, 4, 2};
    const uint32_t turn = trial % small + trial / small;
    const bool strided = conv.stride == 2 && !conv.transposed;
    return make_trial(device, conv, CaseRandom(trial), ConvFamily::tile, precision,
                      strided ? 1 + turn % 2 : kRows.at(turn % kRows.size()), matrices);
}

} // namespace

Trial conv_trial(Device& device, uint32_t trial) {
    return make_trial(device, small_convs().at(trial), CaseRandom(trial),
                      conv_family(device.info()));
}

Trial conv_tile_trial(Device& device, uint32_t trial) {
    return make_tile_trial(device, trial, Precision::float32);
}

Trial conv_tile_half_trial(Device& device, uint32_t trial) {
    return make_tile_trial(device, trial, Precision::float16);
}

Trial conv_matrix_trial(Device& device, uint32_t trial) {
    return make_tile_trial(device, trial, Precision::float16, true);
}

Trial conv_row_trial(Device& device, uint32_t trial) {
    const auto small = static_cast<uint32_t>(small_row_convs().size());
    const ConvCase conv =
        trial < small ? small_row_convs()[trial] : network_convs().at(trial - small);
    return make_trial(device, conv, CaseRandom(trial),
                      row_family(device.info(), std::array{conv.out}));
}

Trial conv_plane_trial(Device& device, uint32_t index) {
    constexpr std::array<std::array<uint32_t, 3>, 4> kShapes = {
        {{32, 9, 23}, {1, 1, 1}, {8, 5, 4}, {40, 3, 45}}};
    const auto [channels, height, width] = kShapes.at(index % kShapes.size());
    const ConvFamily family = index < kShapes.size()
                                  ? conv_family(device.info())
                                  : row_family(device.info(), std::array{kConvRowGroup});
    CaseRandom random(index);
    Trial trial;
    trial.shape = "3x3 " + std::to_string(channels) + "->1 " + std::to_string(width) + "x" +
                  std::to_string(height);
    trial.program = std::make_unique<Program>(device);
    Program& program = *trial.program;
    const Layout in = conv_layout(device.info(), family, channels, height, width);
    const Tensor input = program.input(in);
    trial.output = program.output({1, height, width, 1, 1});
    program.clear(trial.output);
    const auto weight = random.values(size_t{channels} * 9, -0.5, 0.5);
    const auto dense = random.values(size_t{channels} * height * width, -1, 1);
    // Every second case with a bias, and added to an image.
    const bool more = index % 2 == 0;
    const float bias = more ? 0.75F : 0;
    const Tensor image = program.input({1, height, width, 1, 2});
    const auto before = random.values(size_t{height} * width, -1, 1);
    trial.first_step = program.steps();
    const ConvPlane layer(device, channels, 3, weight, bias, family);
    layer.record(program, input, trial.output, more ? std::optional(image) : std::nullopt);
    program.finish();
    program.write(input, from_dense(in, dense));
    program.write(image, from_dense(image.layout(), before));
    trial.reference = reference::conv(std::vector<double>(dense.begin(), dense.end()), channels,
                                      height, width, weight, 1, 3, 1);
    for (size_t i = 0; more && i < before.size(); ++i) {
        trial.reference[i] += double{bias} + before[i];
    }
    return trial;
}

Trial conv_pair_trial(Device& device, uint32_t index) {
    struct Shape {
        uint32_t channels, hidden, height, width;
        bool terms; ///< start, bias and added
    };
    // One slice and several, some of them inside a block of the start, hidden channels that do not
    // fill the kernel's groups, several tiles of the sum, and more inputs than the kernel takes.
    // The last five: as in the fusion networks and `ecir`.
    constexpr std::array<Shape, 13> kShapes = {{{9, 32, 5, 23, false},
                                                {1, 5, 1, 1, true},
                                                {3, 8, 1, 9, false},
                                                {2, 6, 7, 1, true},
                                                {16, 16, 3, 8, true},
                                                {20, 31, 4, 11, true},
                                                {1, 4, 2, 97, false},
                                                {33, 8, 3, 5, true},
                                                {16, 16, 180, 240, true},
                                                {16, 8, 180, 240, true},
                                                {16, 4, 180, 240, true},
                                                {9, 32, 180, 240, false},
                                                {1, 32, 180, 240, false}}};
    const auto [channels, hidden, height, width, terms] = kShapes.at(index);
    CaseRandom random(700 + index);
    const auto first = random.values(size_t{hidden} * channels * 9, -0.5, 0.5);
    const auto second = random.values(size_t{hidden} * 9, -0.5, 0.5);
    const size_t pixels = size_t{height} * width;
    const auto image = random.values(channels * pixels, -1, 1);
    const auto start = random.values(hidden * pixels, -1, 1);
    const auto added = random.values(pixels, -1, 1);

    Trial trial;
    trial.shape = "3x3 " + std::to_string(channels) + "->" + std::to_string(hidden) + "->1 " +
                  std::to_string(width) + "x" + std::to_string(height);
    trial.program = std::make_unique<Program>(device);
    Program& program = *trial.program;
    const Tensor input = program.input({channels, height, width, 1, 1 + index % 2});
    const Tensor start_input =
        program.input({hidden, height, width, channel_block(device.info()), index % 3});
    const Tensor added_input = program.input({1, height, width, 1, index % 2});
    trial.output = program.output({1, height, width, 1, 1});
    program.clear(trial.output);
    const ConvPair layer(device, channels, hidden, first, second, terms ? 0.75F : 0);
    const Tensor scratch = ConvPair::scratch(program, hidden, height, width);
    ConvPair::Terms more;
    if (terms) {
        more = {start_input, added_input};
    }
    layer.record(program, input, scratch, trial.output, more);
    trial.first_step = program.steps();
    layer.record(program, input, scratch, trial.output, more); // the scratch serves again
    program.finish();
    program.write(input, from_dense(input.layout(), image));
    program.write(start_input, from_dense(start_input.layout(), start));
    program.write(added_input, from_dense(added_input.layout(), added));

    auto between = reference::conv(std::vector<double>(image.begin(), image.end()), channels,
                                   height, width, first, hidden, 3, 1);
    for (size_t i = 0; i < between.size(); ++i) {
        between[i] = std::max(between[i] + (terms ? start[i] : 0.0F), 0.0);
    }
    trial.reference = reference::conv(between, hidden, height, width, second, 1, 3, 1);
    for (size_t i = 0; terms && i < pixels; ++i) {
        trial.reference[i] += 0.75 + added[i];
    }
    return trial;
}

} // namespace ecir
