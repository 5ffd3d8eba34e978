#include "tools/stability/interpolation.hpp"

#include <algorithm>
#include <cmath>

#include "layers/curve.hpp"

namespace ecir::stability {
namespace {

constexpr int kSamples = 400; ///< of [-1, 1], where a maximum over it is looked for

/// Lagrange basis i of the keypoints at x.
long double basis(std::span<const float> t, size_t i, long double x) {
    long double product = 1;
    for (size_t j = 0; j < t.size(); ++j) {
        if (j != i) {
            product *= (x - t[j]) / (static_cast<long double>(t[i]) - t[j]);
        }
    }
    return product;
}

/// Coefficients of P in powers of t, in float32.
std::vector<float> monomials(const Knots& knots) {
    const size_t n = knots.size();
    std::vector<float> sum(n, 0.0F);
    for (size_t i = 0; i < n; ++i) {
        std::vector<float> coefficients = {1};
        float denominator = 1;
        for (size_t j = 0; j < n; ++j) {
            if (j == i) {
                continue;
            }
            denominator *= knots.t[i] - knots.t[j];
            coefficients.push_back(0);
            for (size_t k = coefficients.size() - 1; k > 0; --k) {
                coefficients[k] = coefficients[k - 1] - knots.t[j] * coefficients[k];
            }
            coefficients[0] *= -knots.t[j];
        }
        for (size_t k = 0; k < n; ++k) {
            sum[k] += knots.y[i] * coefficients[k] / denominator;
        }
    }
    return sum;
}

/// Legendre polynomials 0 ... count - 1 at x.
std::vector<float> legendre(size_t count, float x) {
    std::vector<float> values = {1, x};
    for (size_t k = 1; k + 1 < count; ++k) {
        const auto order = static_cast<float>(k);
        values.push_back(((2 * order + 1) * x * values[k] - order * values[k - 1]) / (order + 1));
    }
    values.resize(count);
    return values;
}

/// Solves for the coefficients of P, in float32, by elimination with the largest pivot.
std::vector<float> legendre_coefficients(const Knots& knots) {
    const size_t n = knots.size();
    std::vector<std::vector<float>> rows;
    for (size_t i = 0; i < n; ++i) {
        rows.push_back(legendre(n, knots.t[i]));
        rows.back().push_back(knots.y[i]);
    }
    for (size_t k = 0; k < n; ++k) {
        size_t pivot = k;
        for (size_t i = k + 1; i < n; ++i) {
            pivot = std::abs(rows[i][k]) > std::abs(rows[pivot][k]) ? i : pivot;
        }
        std::swap(rows[k], rows[pivot]);
        for (size_t i = k + 1; i < n; ++i) {
            const float factor = rows[i][k] / rows[k][k];
            for (size_t j = k; j <= n; ++j) {
                rows[i][j] -= factor * rows[k][j];
            }
        }
    }
    std::vector<float> solution(n);
    for (size_t k = n; k-- > 0;) {
        float value = rows[k][n];
        for (size_t j = k + 1; j < n; ++j) {
            value -= rows[k][j] * solution[j];
        }
        solution[k] = value / rows[k][k];
    }
    return solution;
}

/// The curve from P at the kernel's Chebyshev nodes.
std::vector<float> curve_from(Form derivative, const Knots& knots, std::span<const float> times) {
    const auto n = static_cast<uint32_t>(knots.size());
    const std::vector<double> wanted(times.begin(), times.end());
    const auto matrix = curve_matrix(n, wanted);
    const auto at_nodes = derivative(knots, std::span(matrix).first(n));
    std::vector<float> values;
    for (size_t f = 0; f < times.size(); ++f) {
        float sum = 0;
        for (size_t k = 0; k < n; ++k) {
            sum += matrix[n + f * n + k] * at_nodes[k];
        }
        values.push_back(sum);
    }
    return values;
}

template <typename Value> std::vector<float> each(std::span<const float> times, Value value) {
    std::vector<float> values;
    for (const float time : times) {
        values.push_back(value(time));
    }
    return values;
}

} // namespace

std::vector<float> monomial_derivative(const Knots& knots, std::span<const float> times) {
    const auto coefficients = monomials(knots);
    return each(times, [&](float time) {
        float value = 0;
        float power = 1;
        for (const float coefficient : coefficients) {
            value += coefficient * power;
            power *= time;
        }
        return value;
    });
}

std::vector<float> monomial_curve(const Knots& knots, std::span<const float> times) {
    const auto coefficients = monomials(knots);
    return each(times, [&](float time) {
        float value = 0;
        float power = time;
        for (size_t k = 0; k < coefficients.size(); ++k) {
            const auto order = static_cast<float>(k + 1);
            const float mean = k % 2 == 1 ? 1 / (order + 1) : 0;
            value += coefficients[k] / order * (power - mean);
            power *= time;
        }
        return value;
    });
}

std::vector<float> barycentric_derivative(const Knots& knots, std::span<const float> times) {
    const size_t n = knots.size();
    std::vector<float> weights(n, 1.0F);
    for (size_t i = 0; i < n; ++i) {
        for (size_t j = 0; j < n; ++j) {
            weights[i] /= j == i ? 1.0F : knots.t[i] - knots.t[j];
        }
    }
    return each(times, [&](float time) {
        float above = 0;
        float below = 0;
        for (size_t i = 0; i < n; ++i) {
            if (time == knots.t[i]) {
                return knots.y[i];
            }
            const float part = weights[i] / (time - knots.t[i]);
            above += part * knots.y[i];
            below += part;
        }
        return above / below;
    });
}

std::vector<float> barycentric_curve(const Knots& knots, std::span<const float> times) {
    return curve_from(barycentric_derivative, knots, times);
}

std::vector<float> newton_derivative(const Knots& knots, std::span<const float> times) {
    const size_t n = knots.size();
    std::vector<float> differences = knots.y;
    for (size_t order = 1; order < n; ++order) {
        for (size_t i = n - 1; i >= order; --i) {
            differences[i] =
                (differences[i] - differences[i - 1]) / (knots.t[i] - knots.t[i - order]);
        }
    }
    return each(times, [&](float time) {
        float value = 0;
        for (size_t i = n; i-- > 0;) {
            value = value * (time - knots.t[i]) + differences[i];
        }
        return value;
    });
}

std::vector<float> newton_curve(const Knots& knots, std::span<const float> times) {
    return curve_from(newton_derivative, knots, times);
}

std::vector<float> legendre_derivative(const Knots& knots, std::span<const float> times) {
    const auto coefficients = legendre_coefficients(knots);
    return each(times, [&](float time) {
        const auto values = legendre(coefficients.size(), time);
        float sum = 0;
        for (size_t k = 0; k < values.size(); ++k) {
            sum += coefficients[k] * values[k];
        }
        return sum;
    });
}

std::vector<float> legendre_curve(const Knots& knots, std::span<const float> times) {
    const auto coefficients = legendre_coefficients(knots);
    return each(times, [&](float time) {
        // The primitive of order k is (P_{k+1} - P_{k-1}) / (2 k + 1); means but that of P_0 are 0.
        const auto values = legendre(coefficients.size() + 1, time);
        float sum = coefficients[0] * values[1];
        for (size_t k = 1; k < coefficients.size(); ++k) {
            const float below = k == 1 ? 0 : values[k - 1];
            sum += coefficients[k] * (values[k + 1] - below) / (2 * static_cast<float>(k) + 1);
        }
        return sum;
    });
}

std::vector<float> lagrange_derivative(const Knots& knots, std::span<const float> times) {
    const size_t n = knots.size();
    return each(times, [&](float time) {
        float sum = 0;
        for (size_t i = 0; i < n; ++i) {
            float above = 1;
            float below = 1;
            for (size_t j = 0; j < n; ++j) {
                if (j != i) {
                    above *= time - knots.t[j];
                    below *= knots.t[i] - knots.t[j];
                }
            }
            sum += knots.y[i] * (above / below);
        }
        return sum;
    });
}

double exact_derivative(const Knots& knots, double time) {
    long double sum = 0;
    for (size_t i = 0; i < knots.size(); ++i) {
        sum += knots.y[i] * basis(knots.t, i, time);
    }
    return static_cast<double>(sum);
}

double lebesgue_constant(std::span<const float> keypoints) {
    double worst = 0;
    for (int s = 0; s <= kSamples; ++s) {
        long double sum = 0;
        for (size_t i = 0; i < keypoints.size(); ++i) {
            sum += std::abs(basis(keypoints, i, 2.0L * s / kSamples - 1));
        }
        worst = std::max(worst, static_cast<double>(sum));
    }
    return worst;
}

double curve_amplification(std::span<const float> keypoints) {
    const auto n = static_cast<uint32_t>(keypoints.size());
    std::vector<double> times;
    for (int s = 0; s <= 40; ++s) {
        times.push_back(2.0 * s / 40 - 1);
    }
    const auto matrix = curve_matrix(n, times);
    std::vector<std::vector<long double>> at_nodes(n);
    for (uint32_t i = 0; i < n; ++i) {
        for (uint32_t k = 0; k < n; ++k) {
            at_nodes[i].push_back(basis(keypoints, i, matrix[k]));
        }
    }
    double worst = 0;
    for (size_t f = 0; f < times.size(); ++f) {
        long double sum = 0;
        for (uint32_t i = 0; i < n; ++i) {
            long double influence = 0;
            for (uint32_t k = 0; k < n; ++k) {
                influence += matrix[n + f * n + k] * at_nodes[i][k];
            }
            sum += std::abs(influence);
        }
        worst = std::max(worst, static_cast<double>(sum));
    }
    return worst;
}

} // namespace ecir::stability
