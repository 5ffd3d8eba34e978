#include "layers/elementwise.hpp"

#include <array>

#include "layers/pixel_dispatch.hpp"
#include "layers/shapes.hpp"

namespace ecir {
namespace {

enum class Operator : uint32_t { sigmoid, multiply, add, add_relu };

constexpr uint32_t kSpan = 4; ///< elements an invocation

/// Mirrors the push constants of shaders/elementwise.comp.
struct Push {
    PushLayout a;
    PushLayout b;
    PushLayout result;
    uint32_t width = 0;
    uint32_t channels = 0;
};
static_assert(sizeof(Push) == 56);

bool is_alike(const Tensor& operand, const Layout& result) {
    return has_shape(operand, result.channels, result.height, result.width) &&
           operand.layout().block == result.block;
}

void record(Program& program, Operator op, float operations, const Tensor& a, const Tensor& b,
            const Tensor& result) {
    const Layout& layout = result.layout();
    const bool shared = op != Operator::sigmoid && layout.block == 1 && b.layout().block == 1 &&
                        has_shape(b, 1, layout.height, layout.width);
    require_shapes(is_alike(a, layout) && (shared || is_alike(b, layout)), "elementwise",
                   {a, b, result});
    Layout largest = layout;
    for (const Tensor* operand : {&a, &b}) {
        if (operand->layout().plane_stride() > largest.plane_stride()) {
            largest = operand->layout();
            largest.channels = layout.channels;
        }
    }
    const std::array<uint32_t, 2> constants{static_cast<uint32_t>(op), kSpan};
    const Kernel& kernel = program.device().kernel("elementwise", constants, 3, sizeof(Push));
    for (const auto& [first, count] :
         channel_groups(program.device().info(), largest, layout.block)) {
        const Tensor target = result.channels(first, count);
        const Tensor left = a.channels(first, count);
        const Tensor right = shared ? b : b.channels(first, count);
        PushLayout right_layout(right);
        right_layout.plane = shared ? 0 : right_layout.plane;
        Dispatch dispatch;
        dispatch.kernel = &kernel;
        dispatch.arguments = {read(left), read(right), update(target)};
        dispatch.set_push(
            Push{PushLayout(left), right_layout, PushLayout(target), layout.width, count});
        dispatch.groups = {(layout.width * layout.block + 64 * kSpan - 1) / (64 * kSpan),
                           layout.height, target.layout().blocks()};
        const double elements = double{1} * count * layout.height * layout.width;
        dispatch.flops = elements * operations;
        dispatch.bytes = elements * 4 * (op == Operator::sigmoid ? 2 : 3);
        dispatch.label = "elementwise";
        program.add(std::move(dispatch));
    }
}

} // namespace

void record_sigmoid(Program& program, const Tensor& a, const Tensor& result) {
    record(program, Operator::sigmoid, 3, a, a, result);
}

void record_multiply(Program& program, const Tensor& a, const Tensor& b, const Tensor& result) {
    record(program, Operator::multiply, 1, a, b, result);
}

void record_add(Program& program, const Tensor& a, const Tensor& b, const Tensor& result,
                bool relu) {
    record(program, relu ? Operator::add_relu : Operator::add, relu ? 2 : 1, a, b, result);
}

} // namespace ecir
