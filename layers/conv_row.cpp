#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <string>

#include "layers/conv.hpp"
#include "layers/shapes.hpp"
#include "runtime/error.hpp"

// The row family of convolutions: what shaders/conv_row.comp and conv_row_up.comp read, and how
// they are launched.

namespace ecir {
namespace {

/// Mirrors the push constants of shaders/conv_row.comp and conv_row_up.comp.
struct RowPush {
    uint64_t in_address = 0;
    uint64_t weight_address = 0;
    uint64_t init_address = 0;
    uint32_t in_row = 0;
    uint32_t in_last = 0;
    uint32_t init_pixel = 0;
    uint32_t init_row = 0;
    uint32_t init_plane = 0;
    uint32_t out_origin = 0;
    uint32_t out_row = 0;
    uint32_t out_plane = 0;
    uint32_t width = 0;
    uint32_t height = 0;
    float floor = 0;
    uint32_t filler = 0;
    std::array<uint32_t, 8> digit{0, 1, 2, 3, 4, 5, 6, 7};
};
static_assert(sizeof(RowPush) == 104);

/// Input channels that a workgroup takes of `inputs`; each: multiply-adds of one with an output
/// channel. The bounds are on a workgroup's code, which the instruction caches should be able to
/// feed, and with stride 2, whose loads are long, on what the driver compiles in a second.
uint32_t slice_inputs(const ConvDesc& desc, uint32_t each, uint32_t inputs) {
    constexpr uint32_t kMost = 3072;
    constexpr uint32_t kMostStrided = 2304;
    const uint32_t most = !desc.transposed && desc.stride == 2 ? kMostStrided : kMost;
    const uint32_t cap = std::max(1U, most / (each * kConvRowGroup));
    return ceil_div(inputs, ceil_div(inputs, cap)); // slices much alike
}

/// Zeros after the weights, for layers that start from nothing.
constexpr uint32_t kZeros = 64;

/// One product of the sums over a kernel's column that make two output rows: its weight is the
/// column times this.
using Product = std::array<float, 5>;

/// As shaders/conv_row.comp orders them.
std::vector<Product> products(const ConvDesc& desc) {
    if (desc.transposed) { // the column as it is
        std::vector<Product> all(desc.kernel);
        for (uint32_t ky = 0; ky < desc.kernel; ++ky) {
            all[ky].at(ky) = 1;
        }
        return all;
    }
    if (desc.kernel == 1 && desc.stride == 1) {
        return {{1}, {1}};
    }
    if (desc.kernel == 3 && desc.stride == 1) {
        return {{1}, {0.5F, 0.5F, 0.5F}, {0.5F, -0.5F, 0.5F}, {0, 0, 1}};
    }
    if (desc.kernel == 3 && desc.stride == 2) {
        return {{1}, {1, 0, 1}, {0, 0, 1}, {0, 1}, {0, 1}};
    }
    if (desc.kernel == 5 && desc.stride == 2) {
        return {{1},
                {0.5F, 0, 0.5F, 0, 0.5F},
                {0.5F, 0, -0.5F, 0, 0.5F},
                {0, 0, 0, 0, 1},
                {0, 1},
                {0, 1, 0, 1},
                {0, 0, 0, 1}};
    }
    throw Error(ExitCode::device, "conv: kernel " + std::to_string(desc.kernel) + " with stride " +
                                      std::to_string(desc.stride) +
                                      " is not supported by the row family");
}

} // namespace

void Conv::pack_row(std::span<const float> weight, std::span<const float> bias) {
    const std::vector<Product> all_products = products(desc_);
    const uint32_t k = desc_.kernel;
    const auto each = static_cast<uint32_t>(all_products.size()) * k; // of an input channel
    std::vector<float> all;
    for (uint32_t input = 0; input < inputs_.size(); ++input) {
        const auto channels = static_cast<uint32_t>(inputs_[input].size());
        const uint32_t most = slice_inputs(desc_, each, channels);
        for (uint32_t first = 0; first < channels; first += most) {
            const uint32_t count = std::min(most, channels - first);
            const bool start = row_slices_.empty();
            row_slices_.push_back({input, first, count, all.size() * sizeof(float)});
            for (uint32_t out = 0; out < desc_.out_channels; out += kConvRowGroup) {
                for (uint32_t c = 0; c < kConvRowGroup; ++c) {
                    all.push_back(start && !bias.empty() ? bias[out + c] : 0);
                }
                for (uint32_t n = 0; n < count * each * kConvRowGroup; ++n) {
                    const uint32_t c = n % kConvRowGroup;
                    const uint32_t in = inputs_[input][first + n / kConvRowGroup / each];
                    const uint32_t place = n / kConvRowGroup % each;
                    // [ky][kx] of the transposed kernel, else [kx][product]
                    const uint32_t kx = desc_.transposed ? place % k : place * k / each;
                    const Product& product =
                        all_products[desc_.transposed ? place / k : place % all_products.size()];
                    float sum = 0;
                    for (uint32_t ky = 0; ky < k; ++ky) {
                        sum += product.at(ky) * weight_at(weight, out + c, in, ky * k + kx);
                    }
                    all.push_back(sum);
                }
            }
        }
    }
    all.resize(all.size() + kZeros);
    weights_ = upload<float>(device_, all);
}

void Conv::record_row(Program& program, std::span<const Tensor> inputs, const Tensor& output,
                      const std::optional<Tensor>& residual) const {
    const Layout& out = output.layout();
    const uint32_t lanes = device_.info().subgroup_size;
    const uint32_t k = desc_.kernel;
    const uint32_t pad = desc_.transposed ? k / 4 : k / 2;
    for (size_t s = 0; s < row_slices_.size(); ++s) {
        const RowSlice& slice = row_slices_[s];
        const Layout& in = inputs[slice.input].layout();
        const std::optional<Tensor> init = s > 0 ? output : residual;
        RowPush push;
        push.in_row = static_cast<uint32_t>(in.row_stride());
        push.in_last = in.height + in.halo + pad - 1;
        push.out_origin = PushLayout(output).origin;
        push.out_row = static_cast<uint32_t>(out.row_stride());
        push.out_plane = static_cast<uint32_t>(out.plane_stride());
        push.width = out.width;
        push.height = out.height;
        push.floor =
            s + 1 == row_slices_.size() && desc_.relu ? 0 : std::numeric_limits<float>::lowest();
        Dispatch dispatch;
        dispatch.arguments = {update(output)};
        dispatch.pointers = {
            {offsetof(RowPush, in_address), ecir::read(inputs[slice.input]),
             (in.offset(slice.first, 0, 0) - pad * in.row_stride() - pad) * 4},
            {offsetof(RowPush, weight_address), constant(weights_, slice.offset), 0}};
        if (init) {
            push.init_pixel = init->layout().block;
            push.init_row = static_cast<uint32_t>(init->layout().row_stride());
            push.init_plane = static_cast<uint32_t>(init->layout().plane_stride());
            dispatch.pointers.push_back(
                {offsetof(RowPush, init_address), ecir::read(*init), init->layout().origin() * 4});
        } else {
            dispatch.pointers.push_back({offsetof(RowPush, init_address), constant(weights_),
                                         weights_->size() - kZeros * sizeof(float)});
        }
        dispatch.set_push(push);
        const auto plane = static_cast<uint32_t>(in.plane_stride());
        const uint32_t block = init ? init->layout().block : desc_.transposed ? 0 : 1;
        const uint32_t groups = desc_.out_channels / kConvRowGroup;
        if (desc_.transposed) {
            const std::array<uint32_t, 5> constants{lanes, slice.count, k, plane, block};
            dispatch.kernel = &device_.kernel("conv_row_up", constants, 1, sizeof(push));
            dispatch.groups = {ceil_div(in.width, lanes), groups, in.height};
            dispatch.label = "conv_row_up";
        } else {
            const std::array<uint32_t, 6> constants{lanes,        slice.count, k,
                                                    desc_.stride, plane,       block};
            dispatch.kernel = &device_.kernel("conv_row", constants, 1, sizeof(push));
            dispatch.groups = {ceil_div(out.width, lanes), groups, ceil_div(out.height, 2)};
            dispatch.label = "conv_row";
        }
        // Of the plain sums, whatever products they take.
        const double summed = (desc_.transposed ? double{1} * in.height * in.width
                                                : double{1} * out.height * out.width);
        dispatch.flops = 2.0 * summed * desc_.out_channels * slice.count * k * k;
        dispatch.bytes = 4.0 * (double{1} * in.height * in.width * slice.count +
                                (init ? 2.0 : 1.0) * out.height * out.width * desc_.out_channels);
        program.add(std::move(dispatch));
    }
}

} // namespace ecir
