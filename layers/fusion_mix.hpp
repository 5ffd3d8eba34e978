#pragma once
#include "layers/prior.hpp"

namespace ecir {

/// Layout of the polynomials' coefficients for `mixed` features: those of T_0, then T_1, ... One
/// set takes whole blocks, whose last channels may be more than the layout of `mixed` has.
inline constexpr uint32_t fusion_basis = 4;
Layout fusion_basis_layout(const Layout& mixed);

/// Records mixed = sum over k of T_k(t) features(k), Chebyshev polynomials of the instant's time.
/// features  of fusion_basis_layout(mixed)
/// instant   one channel of instant_layout()
/// mixed     dense, a multiple of 4 elements; what fills up the last block is written too
/// Throws Error(bad_input) for shapes that do not match.
void record_fusion_mix(Program& program, const Tensor& features, const Tensor& instant,
                       const Tensor& mixed);

} // namespace ecir
