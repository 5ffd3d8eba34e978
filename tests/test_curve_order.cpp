#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "layers/curve.hpp"
#include "tests/curve_support.hpp"

using namespace ecir;
using namespace ecir::test;

TEST_SUITE("curve order") {
    TEST_CASE("the order follows the events of a pixel and its neighbours") {
        // Two events at (1, 0), one at (4, 2): 5 x 3 pixels.
        std::vector<uint32_t> offsets{0};
        for (uint32_t p = 0; p < 15; ++p) {
            offsets.push_back(offsets.back() + (p == 1 ? 2 : p == 14 ? 1 : 0));
        }
        CHECK(curve_orders(offsets, 5, 3, 4) == std::vector<size_t>{5, 4, 6, 0, 0});
        CHECK(curve_orders(offsets, 5, 3, 1) == std::vector<size_t>{5, 10});
        offsets.assign(2, 0);
        offsets.back() = 9;
        CHECK(curve_orders(offsets, 1, 1, 4) == std::vector<size_t>{0, 0, 0, 0, 1});
    }

    TEST_CASE("a curve of lower order: constant without events, the blurry frame in the mean") {
        const auto device = Device::open();
        constexpr uint32_t n = 10;
        const Pixels pixels = make_pixels(n, 5);
        // Far enough apart to have no neighbours in common: pixel 5 p has p events.
        std::vector<uint32_t> offsets{0};
        for (uint32_t p = 0; p < pixels.count; ++p) {
            offsets.push_back(offsets.back() + (p % 5 == 0 ? p / 5 : 0));
        }
        const Quadrature rule = gauss_legendre(n);
        const auto plain = frames(*device, pixels, true, rule.nodes);
        const auto ordered = frames(*device, pixels, true, rule.nodes, offsets);
        for (uint32_t p = 0; p < pixels.count; p += 5) {
            CAPTURE(p);
            double mean = 0;
            double largest = 0;
            double beyond = 0; // share of the Legendre polynomial of the next degree
            const uint32_t order = std::min(p / 5, n);
            for (uint32_t q = 0; q < n; ++q) {
                const double value = ordered[q * pixels.count + p];
                mean += rule.weights[q] / 2 * value;
                largest = std::max(largest, std::abs(value));
                if (order + 1 < n) {
                    beyond += rule.weights[q] * value * std::legendre(order + 1, rule.nodes[q]);
                }
                if (order == 0) {
                    CHECK(ordered[q * pixels.count + p] == pixels.blurry[p]);
                }
                if (order == n) {
                    CHECK(value == doctest::Approx(plain[q * pixels.count + p]).epsilon(1e-4));
                }
            }
            CHECK(std::abs(mean - pixels.blurry[p]) < 1e-6 * largest);
            CHECK(std::abs(beyond) < 1e-6 * largest);
        }
    }
}
