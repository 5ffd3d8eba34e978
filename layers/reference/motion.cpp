#include "layers/reference/motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

namespace ecir::reference {
namespace {

constexpr size_t side = 4; ///< samples of a cell
constexpr size_t gaps = anchor_count - 1;
constexpr size_t windows = prior_windows / gaps; ///< of a gap
constexpr double ridge = 2e-6;
constexpr double fastest = 40;
constexpr double round_ridge = 1e-3;
constexpr double round_limit = 2;

/// One image.
struct Plane {
    size_t height, width;
    std::vector<double> values;

    Plane(size_t rows, size_t columns) : height(rows), width(columns), values(rows * columns) {}
    [[nodiscard]] double& at(size_t y, size_t x) { return values[y * width + x]; }
    /// The border's value outside.
    [[nodiscard]] double edge(int64_t y, int64_t x) const {
        const auto row = std::clamp(y, int64_t{0}, static_cast<int64_t>(height) - 1);
        const auto column = std::clamp(x, int64_t{0}, static_cast<int64_t>(width) - 1);
        return values[static_cast<size_t>(row) * width + static_cast<size_t>(column)];
    }
    /// 0 outside.
    [[nodiscard]] double zero(int64_t y, int64_t x) const {
        const bool inside =
            y >= 0 && x >= 0 && y < static_cast<int64_t>(height) && x < static_cast<int64_t>(width);
        return inside ? edge(y, x) : 0;
    }
    [[nodiscard]] double bilinear(double y, double x) const {
        y = std::clamp(y, 0.0, static_cast<double>(height - 1));
        x = std::clamp(x, 0.0, static_cast<double>(width - 1));
        const auto row = static_cast<int64_t>(y);
        const auto column = static_cast<int64_t>(x);
        const double down = y - static_cast<double>(row);
        const double right = x - static_cast<double>(column);
        return (1 - down) * ((1 - right) * edge(row, column) + right * edge(row, column + 1)) +
               down * ((1 - right) * edge(row + 1, column) + right * edge(row + 1, column + 1));
    }
};

/// Outer product of (1, 2, 1) / 4 with itself, the border repeated.
Plane smooth(const Plane& from) {
    constexpr std::array weights = {0.25, 0.5, 0.25};
    Plane to(from.height, from.width);
    for (size_t i = 0; i < to.values.size(); ++i) {
        for (size_t tap = 0; tap < 9; ++tap) {
            to.values[i] += weights.at(tap / 3) * weights.at(tap % 3) *
                            from.edge(static_cast<int64_t>(i / to.width + tap / 3) - 1,
                                      static_cast<int64_t>(i % to.width + tap % 3) - 1);
        }
    }
    return to;
}

/// Outer product of (1, 4, 6, 4, 1) / 16 with itself, `step` apart, zeros outside.
Plane binomial(const Plane& from, int64_t step) {
    constexpr std::array weights = {0.0625, 0.25, 0.375, 0.25, 0.0625};
    Plane to(from.height, from.width);
    for (size_t i = 0; i < to.values.size(); ++i) {
        for (size_t tap = 0; tap < 25; ++tap) {
            to.values[i] += weights.at(tap / 5) * weights.at(tap % 5) *
                            from.zero(static_cast<int64_t>(i / to.width) +
                                          step * (static_cast<int64_t>(tap / 5) - 2),
                                      static_cast<int64_t>(i % to.width) +
                                          step * (static_cast<int64_t>(tap % 5) - 2));
        }
    }
    return to;
}

/// X with its gradient a full pixel.
struct Slopes {
    Plane x, gx, gy;

    explicit Slopes(Plane plane)
        : x(std::move(plane)), gx(x.height, x.width), gy(x.height, x.width) {
        for (int64_t i = 0; i < static_cast<int64_t>(x.values.size()); ++i) {
            const auto width = static_cast<int64_t>(x.width);
            const auto at = static_cast<size_t>(i);
            gx.values[at] =
                (x.edge(i / width, i % width + 1) - x.edge(i / width, i % width - 1)) / 4;
            gy.values[at] =
                (x.edge(i / width + 1, i % width) - x.edge(i / width - 1, i % width)) / 4;
        }
    }
};

/// Moments of the equations D + d . G = 0 in each cell: Gx Gx, Gx Gy, Gy Gy, Gx D, Gy D.
struct Moments {
    std::vector<Plane> q;

    Moments(size_t rows, size_t columns) : q(5, Plane(rows, columns)) {}
    void add(size_t y, size_t x, double gx, double gy, double d, double weight) {
        const std::array products = {gx * gx, gx * gy, gy * gy, gx * d, gy * d};
        for (size_t m = 0; m < q.size(); ++m) {
            q[m].at(y / side, x / side) += weight * products.at(m) / (side * side);
        }
    }
    void filter(int64_t step) {
        for (Plane& plane : q) {
            plane = binomial(plane, step);
        }
    }
    /// The displacement of a cell.
    [[nodiscard]] std::array<double, 2> solve(size_t cell, double added) const {
        const double a = q[0].values[cell] + added;
        const double b = q[1].values[cell];
        const double c = q[2].values[cell] + added;
        const double determinant = a * c - b * b;
        return {-(c * q[3].values[cell] - b * q[4].values[cell]) / determinant,
                -(a * q[4].values[cell] - b * q[3].values[cell]) / determinant};
    }
};

/// Lucas and Kanade in the windows of a gap.
Moments window_moments(const std::vector<Slopes>& frames, size_t gap, size_t rows, size_t columns) {
    Moments moments(rows, columns);
    for (size_t k = windows * gap; k < windows * (gap + 1); ++k) {
        const Slopes& early = frames[k];
        const Slopes& late = frames[k + 1];
        for (size_t i = 0; i < early.x.values.size(); ++i) {
            moments.add(i / early.x.width, i % early.x.width,
                        (early.gx.values[i] + late.gx.values[i]) / 2,
                        (early.gy.values[i] + late.gy.values[i]) / 2,
                        late.x.values[i] - early.x.values[i], 1.0 / windows);
        }
    }
    moments.filter(1);
    moments.filter(2);
    return moments;
}

/// Gauss and Newton: what remains between two frames moved half-way towards each other.
Moments gap_moments(const Slopes& early, const Slopes& late, const Plane& dx, const Plane& dy) {
    Moments moments(dx.height, dx.width);
    const auto inside = [&](double y, double x) {
        return y >= -0.5 && x >= -0.5 && y <= static_cast<double>(early.x.height) - 0.5 &&
               x <= static_cast<double>(early.x.width) - 0.5;
    };
    for (size_t y = 0; y < early.x.height; ++y) {
        for (size_t x = 0; x < early.x.width; ++x) {
            const double row = (static_cast<double>(y) + 0.5) / side - 0.5;
            const double column = (static_cast<double>(x) + 0.5) / side - 0.5;
            const double up = dy.bilinear(row, column) / 4; // half of it, in samples
            const double left = dx.bilinear(row, column) / 4;
            const double y0 = static_cast<double>(y) - up;
            const double x0 = static_cast<double>(x) - left;
            const double y1 = static_cast<double>(y) + up;
            const double x1 = static_cast<double>(x) + left;
            if (inside(y0, x0) && inside(y1, x1)) {
                moments.add(y, x, (early.gx.bilinear(y0, x0) + late.gx.bilinear(y1, x1)) / 2,
                            (early.gy.bilinear(y0, x0) + late.gy.bilinear(y1, x1)) / 2,
                            late.x.bilinear(y1, x1) - early.x.bilinear(y0, x0), 1);
            }
        }
    }
    moments.filter(1);
    return moments;
}

} // namespace

std::vector<double> motion(std::span<const float> logarithms, uint32_t height, uint32_t width) {
    const size_t plane = size_t{height} * width;
    std::vector<Slopes> frames;
    for (size_t k = 0; k <= prior_windows; ++k) {
        Plane x(height, width);
        std::ranges::copy(logarithms.subspan(k * plane, plane), x.values.begin());
        frames.emplace_back(smooth(x));
    }
    const size_t rows = (height + side - 1) / side;
    const size_t columns = (width + side - 1) / side;
    const size_t cells = rows * columns;
    std::vector<Plane> moved(2 * gaps, Plane(rows, columns)); // x and y by gap
    for (size_t g = 0; g < gaps; ++g) {
        const Moments moments = window_moments(frames, g, rows, columns);
        for (size_t cell = 0; cell < cells; ++cell) {
            const auto window = moments.solve(cell, ridge);
            for (size_t i = 0; i < 2; ++i) {
                moved[2 * g + i].values[cell] =
                    std::clamp(double{windows} * window.at(i), -fastest, fastest);
            }
        }
    }
    for (size_t g = 0; g < gaps; ++g) {
        Plane& dx = moved[2 * g];
        Plane& dy = moved[2 * g + 1];
        for (uint32_t round = 0; round < motion_rounds; ++round) {
            const Moments rest =
                gap_moments(frames[windows * g], frames[windows * (g + 1)], dx, dy);
            for (size_t cell = 0; cell < cells; ++cell) {
                const auto more = rest.solve(cell, round_ridge);
                dx.values[cell] += std::clamp(more[0], -round_limit, round_limit);
                dy.values[cell] += std::clamp(more[1], -round_limit, round_limit);
            }
        }
    }
    std::vector<double> dense;
    for (const Plane& part : moved) {
        dense.insert(dense.end(), part.values.begin(), part.values.end());
    }
    return dense;
}

std::vector<double> anchor_velocity(std::span<const double> moved) {
    const size_t cells = moved.size() / (2 * gaps);
    std::vector<double> velocity;
    for (size_t channel = 0; channel < 2 * size_t{anchor_count}; ++channel) {
        const size_t a = channel / 2;
        const auto before = moved.subspan((2 * (std::max<size_t>(a, 1) - 1) + channel % 2) * cells);
        const auto after = moved.subspan((2 * std::min(a, gaps - 1) + channel % 2) * cells);
        for (size_t cell = 0; cell < cells; ++cell) {
            velocity.push_back(2 * (before[cell] + after[cell]));
        }
    }
    return velocity;
}

} // namespace ecir::reference

namespace ecir {
namespace {

struct Case {
    uint32_t height, width; ///< of the frames that the logarithms come from
    double speed;           ///< pixels a unit of time
    double noise;
    double slant;  ///< of the texture; 0 for stripes, whose motion along themselves is unknown
    bool channels; ///< the input of the convolution is compared, blocked
};

/// The last one: as in the network.
constexpr std::array<Case, 10> cases = {{
    {16, 16, 4, 0, 1, false},
    {17, 33, 12, 0.002, 1, true},
    {45, 61, 20, 0.01, 1, false},
    {64, 40, 45, 0.002, 1, true},
    {1, 3, 2, 0, 1, false},
    {31, 150, 70, 0.05, 1, false},
    {40, 40, 0, 0, 1, false}, // flat and still
    {33, 50, 15, 0, 0, false},
    {50, 47, 15, 0.01, 0, false},
    {180, 240, 20, 0.01, 1, false},
}};

/// Oblique stripes.
constexpr std::array<Case, 2> oblique_cases = {{
    {45, 61, 20, 0, 0, false},
    {64, 40, 12, 0, 0, true},
}};

/// lean: columns by which the texture moves from one row to the next; it is as much finer too.
Trial make_trial(Device& device, const Case& shape, CaseRandom random, double lean) {
    const uint32_t height = (shape.height + 1) / 2;
    const uint32_t width = (shape.width + 1) / 2;
    // Waves that move, turning, with noise that changes from frame to frame.
    std::vector<float> logarithms;
    for (uint32_t k = 0; k <= prior_windows; ++k) {
        const double time = 2.0 * k / prior_windows - 1;
        const double dx = shape.speed * time;
        const double dy = shape.speed * time * time / 2;
        for (uint32_t i = 0; i < height * width; ++i) {
            const uint32_t row = i / width;
            const double x = (1 + lean) * (2.0 * (i % width) + lean * 2.0 * row - dx);
            const double y = shape.slant * (2.0 * row - dy);
            const double wave =
                std::sin(x / 9 + y / 23) + std::cos(y / 7 - x / 31) + 0.5 * std::sin((x + y) / 5);
            logarithms.push_back(static_cast<float>((shape.speed > 0 ? 0.5 * wave : 0) - 1 +
                                                    random.uniform(-shape.noise, shape.noise)));
        }
    }
    const Layout field = motion_layout(shape.height, shape.width);
    const Layout channels{2 * anchor_count, field.height, field.width, 8, 1};

    Trial result;
    result.shape = std::to_string(shape.width) + "x" + std::to_string(shape.height) + ", " +
                   std::to_string(static_cast<int>(shape.speed)) + " pixels a unit of time";
    result.program = std::make_unique<Program>(device);
    Program& program = *result.program;
    const Tensor input = program.input({prior_windows + 1, height, width});
    const auto make = [&](const Layout& layout, bool compared) {
        const Tensor tensor = compared ? program.output(layout) : program.temporary(layout);
        program.clear(tensor);
        return tensor;
    };
    const Tensor moved = make(field, !shape.channels);
    const Tensor velocity = make(channels, shape.channels);
    result.output = shape.channels ? velocity : moved;
    result.first_step = program.steps();
    record_motion(program, input, moved, velocity);
    program.finish();
    program.write(input, logarithms);
    result.reference = reference::motion(logarithms, height, width);
    if (shape.channels) {
        result.reference = reference::anchor_velocity(result.reference);
        for (double& value : result.reference) {
            value *= 0.05;
        }
    }
    return result;
}

} // namespace

Trial motion_trial(Device& device, uint32_t trial) {
    return make_trial(device, cases.at(trial), CaseRandom(900 + trial), 0);
}

Trial motion_oblique_trial(Device& device, uint32_t trial) {
    return make_trial(device, oblique_cases.at(trial), CaseRandom(950 + trial), 0.7);
}

} // namespace ecir
