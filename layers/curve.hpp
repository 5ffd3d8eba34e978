#pragma once
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "layers/keypoints.hpp"
#include "runtime/program.hpp"

namespace ecir {

/// The intensity curve of a pixel (equations 6 and 7 of the paper): the polynomial P through the n
/// derivatives y_i at the keypoints t_i, integrated, with the constant that makes the mean over the
/// exposure [-1, 1] the blurry frame B (equation 3).
///
/// The published code expands P in monomials and loses digits to cancellation. Here
///     P(x_k) = sum_i y_i w_i prod_{j != i} (x_k - t_j),   w_i = 1 / prod_{j != i} (t_i - t_j)
///     L(t)   = B + sum_k S(t, k) P(x_k)
/// with the n Chebyshev nodes x_k. A Lagrange basis value is one product of rounded differences, so
/// its relative error is a few n rounding errors wherever the keypoints lie, and a node may meet a
/// keypoint. S integrates the fixed nodes' basis and depends on the times alone; every column's
/// mean over the exposure is 0, so the mean of L is B whatever P is.
///
/// Measured (tests/test_curve.cpp): |error of L| <= n eps (|B| + sum_k |S(t, k)| sum_i |l_i(x_k)|
/// |y_i|), eps = 2^-23, for n = 2 ... 20 and keypoints down to 1 us apart (0.3 n eps from n = 6
/// on); the mean is B to 2 eps of the curve's largest value. With n = 10, keypoints anywhere in
/// their cells and |y| <= 4, the largest error is 9e-6, in float32 monomials 2e-2.
///
/// How far derivatives can throw the curve is a matter of the problem itself, A = max_t sum_i
/// |dL/dy_i|:
///     n                                         2     5     10     13     16     20
///     keypoints on the pivots                   1     1      2    7.5     33    300
///     anywhere, some 1 us of 120 ms apart     4e4   2e4    4e4    2e5    3e5    2e6
///     the same, spread (`paper`)                6    14     57    260   1100   6700
/// Derivatives with an error e give frames with errors up to A e. Spreading keeps A within 64 times
/// that of the pivots; the `release` variant leaves close neighbours as they are, as its weights
/// expect.

/// Gauss-Legendre nodes and weights on [-1, 1], exact for polynomials up to degree 2 count - 1.
struct Quadrature {
    std::vector<double> nodes;
    std::vector<double> weights;
};
Quadrature gauss_legendre(uint32_t count);

/// The n Chebyshev nodes -cos((2 k + 1) pi / 2 n), ascending, rounded to float32.
std::vector<float> curve_nodes(uint32_t n);

/// What the kernel reads for the normalised `times`: the n nodes, then S by rows of n, one per
/// time, S(t, k) = integral from -1 to t of the nodes' Lagrange basis k, less its mean over the
/// exposure; in double, rounded once. Throws Error(bad_input) for n outside 2 ... 20 or a time
/// outside [-1, 1].
std::vector<float> curve_matrix(uint32_t n, std::span<const double> times);

/// What the kernel reads where the curve's order follows the events: the n nodes, then C by rows of
/// n, C(j, k) the share of the nodes' Lagrange basis k in the Legendre polynomial j, then T by rows
/// of n, one per time, T(t, j) = integral from -1 to t of the Legendre polynomial j, less its mean
/// over the exposure. Errors as curve_matrix().
std::vector<float> curve_series(uint32_t n, std::span<const double> times);

/// Layout of the input that takes curve_matrix(), or with `ordered` curve_series(), for n keypoints
/// and d times.
Layout curve_matrix_layout(uint32_t n, uint32_t d, bool ordered = false);

/// Pixels by the order that their curve has where it follows the events, 0 to n: an order is
/// min(n, events of the 3 x 3 pixels around), 0 a curve that is constant. Events that a pixel has
/// alone would not do: where brightness changes by less than the threshold neighbours tell of it.
/// offsets: PackedEvents::offset.
std::vector<size_t> curve_orders(std::span<const uint32_t> offsets, uint32_t width, uint32_t height,
                                 uint32_t n);

/// Smallest distance of keypoints that `spaced` leaves: a sixteenth of the pivots' distance.
float keypoint_spacing(uint32_t n);

/// How to read the inputs of record_curve().
struct CurveOptions {
    uint32_t n = 10;    ///< keypoints, 2 ... 20
    bool spaced = true; ///< `paper`: spread keypoints first; `release`: take them as they are
    uint32_t derivative_channel = 0; ///< first channel of the derivatives
    uint32_t keypoint_channel = 0;   ///< first channel of the keypoints
    uint32_t blurry_channel = 0;
    /// [1][1][height * width + 1], PackedEvents::offset: the curve's order follows the events, as
    /// curve_orders() says, and the matrix holds curve_series().
    std::optional<Tensor> offsets{};
};

/// Records the frames at the times of `matrix`.
/// derivatives, keypoints, blurry  tensors of one height and width in any layouts; a pixel's
/// keypoints
///                                 ascend (two may be equal)
/// matrix                          input of curve_matrix_layout(n, frames' channels, ordered)
/// frames                          output, one channel a time, any layout of block 1
/// Throws Error(bad_input) when n or the channels do not fit.
void record_curve(Program& program, const Tensor& derivatives, const Tensor& keypoints,
                  const Tensor& blurry, const Tensor& matrix, const Tensor& frames,
                  const CurveOptions& options);

} // namespace ecir
