#include "layers/reference/elementwise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "layers/elementwise.hpp"

namespace ecir {
namespace {

enum class Operator { sigmoid, multiply, add, add_relu };

struct Case {
    Operator op;
    uint32_t channels, height, width;
    uint32_t block;                ///< 0 for the device's
    std::array<uint32_t, 3> halos; ///< of a, b and the result
    bool in_place;                 ///< the result is a
    bool shared = false;           ///< b is one channel
};

/// The last two: as in eSL-Net.
constexpr std::array<Case, 14> cases = {{
    {Operator::sigmoid, 40, 7, 19, 8, {0, 0, 0}, true},
    {Operator::sigmoid, 5, 3, 33, 8, {1, 0, 2}, false},
    {Operator::sigmoid, 1, 1, 1, 1, {0, 0, 0}, false},
    {Operator::multiply, 40, 5, 65, 8, {0, 0, 1}, false},
    {Operator::multiply, 17, 9, 4, 16, {0, 1, 0}, true},
    {Operator::multiply, 3, 2, 259, 1, {0, 0, 0}, false},
    {Operator::add, 128, 3, 21, 8, {1, 0, 1}, true},
    {Operator::add, 1, 1, 1, 8, {0, 0, 1}, false},
    {Operator::add_relu, 20, 11, 32, 8, {1, 0, 1}, true},
    {Operator::add_relu, 7, 4, 31, 4, {0, 2, 1}, false},
    {Operator::add, 14, 9, 7, 1, {0, 0, 0}, true, true},
    {Operator::multiply, 5, 3, 66, 1, {1, 2, 0}, false, true},
    {Operator::multiply, 40, 180, 240, 0, {0, 0, 1}, false},
    {Operator::add, 128, 180, 240, 0, {1, 0, 1}, true},
}};

std::string describe(const Case& shape) {
    constexpr std::array<const char*, 4> kNames = {"sigmoid ", "multiply ", "add ", "add, relu "};
    return kNames.at(static_cast<size_t>(shape.op)) + std::to_string(shape.channels) + "x" +
           std::to_string(shape.height) + "x" + std::to_string(shape.width) + " block " +
           std::to_string(shape.block) + (shape.in_place ? " in place" : "") +
           (shape.shared ? " one channel for all" : "");
}

double expected(Operator op, double a, double b) {
    switch (op) {
    case Operator::sigmoid:
        return 1 / (1 + std::exp(-a));
    case Operator::multiply:
        return a * b;
    case Operator::add:
        return a + b;
    case Operator::add_relu:
        break;
    }
    return std::max(a + b, 0.0);
}

} // namespace

Trial elementwise_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.block = case_block(device, shape.block);
    CaseRandom random(600 + trial);
    const bool sigmoid = shape.op == Operator::sigmoid;
    Trial result;
    result.shape = describe(shape);
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const auto layout = [&](size_t which) {
        return Layout{shape.channels, shape.height, shape.width, shape.block,
                      shape.halos.at(which)};
    };
    const Tensor a = program.input(layout(0));
    Layout second_layout = layout(1);
    second_layout.channels = shape.shared ? 1 : shape.channels;
    const Tensor b = sigmoid ? a : program.input(second_layout);
    result.output = program.output(layout(2));
    program.clear(result.output);
    const Tensor& left = shape.in_place ? result.output : a;
    if (shape.in_place) { // a first goes to where the result will be: adding nothing copies it
        const Tensor zero = program.temporary(layout(0));
        program.clear(zero);
        record_add(program, a, zero, result.output);
    }
    result.first_step = program.steps();
    switch (shape.op) {
    case Operator::sigmoid:
        record_sigmoid(program, left, result.output);
        break;
    case Operator::multiply:
        record_multiply(program, left, b, result.output);
        break;
    default:
        record_add(program, left, b, result.output, shape.op == Operator::add_relu);
    }
    program.finish();

    const size_t count = size_t{shape.channels} * shape.height * shape.width;
    auto first = random.values(count, -4, 4);
    if (sigmoid) { // both ends, where the exponential overflows and where it vanishes
        first.front() = -100;
        first.back() = 100;
    }
    const size_t given = shape.shared ? size_t{shape.height} * shape.width : count;
    const auto second = sigmoid ? first : random.values(given, -4, 4);
    program.write(a, from_dense(a.layout(), first));
    program.write(b, from_dense(b.layout(), second));
    for (size_t i = 0; i < count; ++i) {
        result.reference.push_back(expected(shape.op, first[i], second[i % given]));
    }
    return result;
}

} // namespace ecir
