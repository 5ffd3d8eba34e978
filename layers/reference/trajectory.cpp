#include "layers/reference/trajectory.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>

#include "layers/elementwise.hpp"
#include "layers/fusion_fetch.hpp"

namespace ecir::reference {
namespace {

constexpr double cell = 8; ///< pixels a side

/// Bilinear value of an image, samples at whole coordinates, the border's value outside.
double bilinear(std::span<const float> image, uint32_t height, uint32_t width, double y, double x) {
    y = std::clamp(y, 0.0, height - 1.0);
    x = std::clamp(x, 0.0, width - 1.0);
    const auto row = static_cast<size_t>(y);
    const auto column = static_cast<size_t>(x);
    const size_t below = std::min<size_t>(row + 1, height - 1);
    const size_t beside = std::min<size_t>(column + 1, width - 1);
    const double down = y - static_cast<double>(row);
    const double right = x - static_cast<double>(column);
    const auto at = [&](size_t v, size_t u) { return double{image[v * width + u]}; };
    return (1 - down) * ((1 - right) * at(row, column) + right * at(row, beside)) +
           down * ((1 - right) * at(below, column) + right * at(below, beside));
}

std::span<const float> frame_of(std::span<const float> frames, size_t index, size_t pixels) {
    return frames.subspan(index * pixels, pixels);
}

/// Appends the differences of a frame at an anchor, fetched along `away`, to another one.
void append_fetched(std::vector<double>& result, std::span<const float> frame, size_t anchor,
                    std::span<const float> away, std::span<const float> base, uint32_t height,
                    uint32_t width) {
    const Layout cells = away_layout(height, width);
    const size_t field = size_t{cells.height} * cells.width;
    for (size_t p = 0; p < base.size(); ++p) {
        const size_t line = p / width;
        const auto y = static_cast<double>(line);
        const auto x = static_cast<double>(p % width);
        const auto moved = [&](size_t i) {
            return bilinear(away.subspan((2 * anchor + i) * field, field), cells.height,
                            cells.width, (y + 0.5) / cell - 0.5, (x + 0.5) / cell - 0.5);
        };
        const double column = x + moved(0);
        const double row = y + moved(1);
        const bool inside =
            row >= -0.5 && column >= -0.5 && row <= height - 0.5 && column <= width - 0.5;
        result.push_back(inside ? bilinear(frame, height, width, row, column) - base[p] : 0);
    }
}

} // namespace

std::vector<double> trajectory(std::span<const float> moved, double time, uint32_t rows,
                               uint32_t columns) {
    using Vector = std::array<double, 2>; // x, y
    const size_t plane = size_t{rows} * columns;
    constexpr size_t gaps = anchor_count - 1;
    const double place = (time + 1) * gaps / 2;
    const size_t below = std::min(static_cast<size_t>(place), gaps - 1);
    const double share = place - static_cast<double>(below);
    const auto plus = [](const Vector& a, double factor, const Vector& b) {
        return Vector{a[0] + factor * b[0], a[1] + factor * b[1]};
    };
    /// At a position in pixels.
    const auto moved_at = [&](size_t gap, const Vector& p) {
        Vector found{};
        for (size_t i = 0; i < 2; ++i) {
            found.at(i) = bilinear(moved.subspan((2 * gap + i) * plane, plane), rows, columns,
                                   (p[1] + 0.5) / cell - 0.5, (p[0] + 0.5) / cell - 0.5);
        }
        return found;
    };
    /// Of what is at p when `ahead` of the gap is still to come until its middle.
    const auto gap_moved = [&](size_t gap, const Vector& p, double ahead) {
        return moved_at(gap, plus(p, ahead, moved_at(gap, p)));
    };
    std::vector<double> away(2 * size_t{anchor_count} * plane);
    for (size_t at = 0; at < plane; ++at) {
        const size_t row = at / columns;
        const size_t column = at % columns;
        const Vector centre = {static_cast<double>(column) * cell + (cell - 1) / 2,
                               static_cast<double>(row) * cell + (cell - 1) / 2};
        const auto set = [&](size_t anchor, const Vector& p) {
            away[2 * anchor * plane + at] = p[0] - centre[0];
            away[(2 * anchor + 1) * plane + at] = p[1] - centre[1];
        };
        const Vector around = gap_moved(below, centre, 0.5 - share);
        Vector p = plus(centre, -share, around);
        set(below, p);
        for (size_t gap = below; gap-- > 0;) {
            p = plus(p, -1, gap_moved(gap, p, -0.5));
            set(gap, p);
        }
        p = plus(centre, 1 - share, around);
        set(below + 1, p);
        for (size_t gap = below + 1; gap < gaps; ++gap) {
            p = plus(p, 1, gap_moved(gap, p, 0.5));
            set(gap + 1, p);
        }
    }
    return away;
}

std::vector<double> fusion_fetch(std::span<const float> anchors, std::span<const float> away,
                                 std::span<const float> prior, double time, uint32_t height,
                                 uint32_t width) {
    std::array<size_t, anchor_count> order{};
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(order, {}, [&](size_t a) {
        return std::abs((time + 1) * (anchor_count - 1) / 2 - static_cast<double>(a));
    });
    std::vector<double> result;
    for (const size_t anchor : order) {
        append_fetched(result, frame_of(anchors, anchor, prior.size()), anchor, away, prior, height,
                       width);
    }
    return result;
}

std::vector<double> reference_fetch(std::span<const float> references, std::span<const float> away,
                                    std::span<const float> frame, uint32_t height, uint32_t width) {
    constexpr size_t step = (anchor_count - 1) / (reference_count - 1);
    std::vector<double> result;
    for (size_t i = 0; i < reference_count; ++i) {
        append_fetched(result, frame_of(references, i, frame.size()), i * step, away, frame, height,
                       width);
    }
    return result;
}

} // namespace ecir::reference

namespace ecir {
namespace {

struct Case {
    uint32_t height, width; ///< pixels
    double time;
    double speed;       ///< most, pixels a unit of time; of displacements, pixels
    uint32_t block = 8; ///< of the planes that are fetched
};

/// The last one: as in the network.
constexpr std::array<Case, 10> cases = {{
    {16, 16, 0.3, 10, 1},
    {17, 33, -1, 30},
    {45, 61, 1, 60, 1},
    {64, 40, 0.125, 20},  // half-way between anchors
    {31, 90, 0.25, 0, 1}, // at an anchor
    {1, 1, -0.9, 5},
    {8, 530, 0.8, 160, 1},
    {49, 51, -0.125, 8},
    {24, 23, -0.6, 300, 1},
    {180, 240, 0.3, 10, 1},
}};

std::string describe(const Case& shape) {
    return std::to_string(shape.width) + "x" + std::to_string(shape.height) + " at " +
           std::to_string(shape.time) + ", up to " + std::to_string(static_cast<int>(shape.speed));
}

/// Two instants, of which the second is the case's; write_instants() fills them.
void write_instants(Program& program, const Tensor& instants, const Case& shape) {
    const std::vector<Instant> both = {Instant(0.5), Instant(shape.time)};
    program.write(instants, std::as_bytes(std::span(both)));
}

} // namespace

Trial trajectory_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.time = double{static_cast<float>(shape.time)};
    CaseRandom random(1000 + trial);
    Trial result;
    result.shape = describe(shape) + " pixels a gap";
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Layout layout = motion_layout(shape.height, shape.width);
    // Alike all over, but for so little that paths do not part: rounding would part them as well.
    const auto common = random.values(layout.channels, -shape.speed, shape.speed);
    auto values = random.values(size_t{layout.channels} * layout.height * layout.width, -4, 4);
    for (size_t i = 0; i < values.size(); ++i) {
        values[i] = shape.speed > 0 ? values[i] + common[i / layout.height / layout.width] : 0;
    }
    const Tensor moved = program.input(layout);
    const Tensor instants = program.input(instant_layout(2));
    result.output = program.output(away_layout(shape.height, shape.width));
    result.first_step = program.steps();
    record_trajectory(program, moved, instants.channels(1, 1), result.output);
    program.finish();
    program.write(moved, from_dense(layout, values));
    write_instants(program, instants, shape);
    result.reference = reference::trajectory(values, shape.time, layout.height, layout.width);
    return result;
}

Trial fusion_fetch_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.time = double{static_cast<float>(shape.time)};
    CaseRandom random(1100 + trial);
    Trial result;
    result.shape = describe(shape) + " pixels away";
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const size_t pixels = size_t{shape.height} * shape.width;
    const Layout cells = away_layout(shape.height, shape.width);
    const Layout layout{plane_count, shape.height, shape.width, shape.block, 2};
    // Of little contrast, since the kernel knows where it is within half a unit in the last place.
    const auto frames = random.values(anchor_count * pixels, 0.4, 0.6);
    const auto displacements = random.values(size_t{cells.channels} * cells.height * cells.width,
                                             -shape.speed, shape.speed);
    const auto before = random.values(plane_count * pixels, 0, 1);
    const Tensor anchors = program.input({anchor_count, shape.height, shape.width, 1, 1});
    const Tensor away = program.input(cells);
    const Tensor planes = program.input(layout);
    const Tensor instants = program.input(instant_layout(2));
    const Tensor zero = program.temporary(layout);
    result.output = program.output(layout);
    program.clear(zero);
    program.clear(result.output);
    record_add(program, planes, zero, result.output); // a copy
    result.first_step = program.steps();
    record_fusion_fetch(program, anchors, away, instants.channels(1, 1), result.output);
    program.finish();
    program.write(anchors, from_dense(anchors.layout(), frames));
    program.write(away, from_dense(cells, displacements));
    program.write(planes, from_dense(layout, before));
    write_instants(program, instants, shape);
    const auto fetched =
        reference::fusion_fetch(frames, displacements, std::span(before).first(pixels), shape.time,
                                shape.height, shape.width);
    result.reference.assign(before.begin(), before.end());
    std::ranges::copy(fetched, result.reference.begin() + static_cast<ptrdiff_t>(2 * pixels));
    return result;
}

Trial reference_fetch_trial(Device& device, uint32_t trial) {
    Case shape = cases.at(trial);
    shape.time = double{static_cast<float>(shape.time)};
    CaseRandom random(1400 + trial);
    Trial result;
    result.shape = describe(shape) + " pixels away";
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const size_t pixels = size_t{shape.height} * shape.width;
    const Layout cells = away_layout(shape.height, shape.width);
    const auto frames = random.values(reference_count * pixels, 0.4, 0.6);
    const auto own = random.values(pixels, 0, 1);
    const auto displacements = random.values(size_t{cells.channels} * cells.height * cells.width,
                                             -shape.speed, shape.speed);
    const Tensor references = program.input({reference_count, shape.height, shape.width});
    const Tensor frame = program.input({1, shape.height, shape.width});
    const Tensor away = program.input(cells);
    const Tensor instants = program.input(instant_layout(2));
    result.output = program.output({reference_count, shape.height, shape.width});
    result.first_step = program.steps();
    record_reference_fetch(program, references, away, instants.channels(1, 1), frame,
                           result.output);
    program.finish();
    program.write(references, frames);
    program.write(frame, own);
    program.write(away, from_dense(cells, displacements));
    write_instants(program, instants, shape);
    result.reference =
        reference::reference_fetch(frames, displacements, own, shape.height, shape.width);
    return result;
}

} // namespace ecir
