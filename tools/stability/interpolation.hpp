#pragma once
#include <cstdint>
#include <span>
#include <vector>

/// Ways to compute the polynomial P through the derivatives y_i at the keypoints t_i, and the curve
/// L(t) = B + its primitive less the primitive's mean over [-1, 1] (layers/curve.hpp), in float32
/// throughout: what the choice of the form costs.
namespace ecir::stability {

/// One pixel: keypoints that ascend and differ, one derivative each.
struct Knots {
    std::vector<float> t;
    std::vector<float> y;
    [[nodiscard]] size_t size() const { return t.size(); }
};

/// A form of the computation: P or L at each of the times.
using Form = std::vector<float> (*)(const Knots&, std::span<const float> times);

/// Coefficients of 1, t, t^2, ...: the published way.
std::vector<float> monomial_derivative(const Knots& knots, std::span<const float> times);
std::vector<float> monomial_curve(const Knots& knots, std::span<const float> times);
/// The second barycentric formula; the curve from P at the Chebyshev nodes, as the kernel has it.
std::vector<float> barycentric_derivative(const Knots& knots, std::span<const float> times);
std::vector<float> barycentric_curve(const Knots& knots, std::span<const float> times);
/// Newton's divided differences, nested; the curve likewise.
std::vector<float> newton_derivative(const Knots& knots, std::span<const float> times);
std::vector<float> newton_curve(const Knots& knots, std::span<const float> times);
/// Legendre coefficients by elimination with pivots; the primitive term by term.
std::vector<float> legendre_derivative(const Knots& knots, std::span<const float> times);
std::vector<float> legendre_curve(const Knots& knots, std::span<const float> times);
/// Products of rounded differences, as shaders/curve.comp evaluates P.
std::vector<float> lagrange_derivative(const Knots& knots, std::span<const float> times);

/// P in 80-bit floats.
double exact_derivative(const Knots& knots, double time);

/// max over [-1, 1] of sum_i |dP(t) / dy_i|: the Lebesgue constant of the keypoints.
double lebesgue_constant(std::span<const float> keypoints);
/// max over [-1, 1] of sum_i |dL(t) / dy_i|: how an error of the derivatives grows in the frames.
double curve_amplification(std::span<const float> keypoints);

} // namespace ecir::stability
