#include <algorithm>
#include <cmath>
#include <doctest/doctest.h>
#include <functional>
#include <stdexcept>
#include <tuple>
#include <vector>

#include "runtime/error.hpp"
#include "tests/simulate_support.hpp"
#include "tools/simulate/esim.hpp"
#include "tools/simulate/motion.hpp"
#include "tools/simulate/recording.hpp"
#include "tools/simulate/scene.hpp"

using namespace ecir;
using namespace ecir::sim;
using namespace ecir::test;

namespace {

/// The intensity whose log(I + eps) is `log`.
float intensity(double log) {
    return static_cast<float>(std::exp(log) - log_offset);
}

/// A pixel whose log intensity follows `log` over `steps` frames of 1 ms.
Events follow(const CameraModel& model, int steps, const std::function<double(double)>& log) {
    EventCamera camera(model, 1, 1);
    for (int i = 0; i <= steps; ++i) {
        const std::vector<float> frame{intensity(log(i))};
        camera.see(frame, 1000.0 * i);
    }
    return camera.take(0);
}

} // namespace

TEST_SUITE("simulate") {
    TEST_CASE("a ramp of log intensity gives the events of the model at their times") {
        // From -2 up by 1 in 10 ms: a crossing each 0.2, that is each 2 ms. Then down by 1 in 10 ms
        // from -1, last crossing up at -1: crossings each 0.25, that is each 2.5 ms.
        const auto ramp = [](double ms) {
            return ms <= 10 ? -2 + 0.1001 * ms : -1 - 0.1001 * (ms - 10);
        };
        const Events events = follow(ideal(0.2, 0.25), 20, ramp);
        std::vector<int64_t> expected;
        for (int i = 1; i <= 5; ++i) {
            expected.push_back(std::llround(1e6 * 0.2 * i / 100.1));
        }
        const double top = -2 + 0.1001 * 10;
        for (int i = 1; i <= 4; ++i) {
            const double level = -1 - 0.25 * i; // the last event up left the reference at -1
            expected.push_back(10'000 + std::llround(1e6 * (-1 - level) / 100.1));
        }
        CHECK(top > -1);
        REQUIRE(events.size() == expected.size());
        for (size_t i = 0; i < expected.size(); ++i) {
            CHECK(std::abs(events.t[i] - expected[i]) <= 1); // the frames are float32
            CHECK(events.p[i] == (i < 5 ? 1 : 0));
        }
    }

    TEST_CASE("integrated events follow the log intensity within a threshold") {
        const auto log = [](double ms) {
            return -1.5 + std::sin(0.11 * ms) + 0.3 * std::sin(0.5 * ms);
        };
        const double positive = 0.15, negative = 0.22;
        const Events events = follow(ideal(positive, negative), 200, log);
        CHECK(events.size() > 20);
        size_t next = 0;
        double sum = log(0);
        for (int i = 0; i <= 200; ++i) {
            for (; next < events.size() && events.t[next] <= 1000 * i; ++next) {
                sum += events.p[next] == 1 ? positive : -negative;
            }
            CHECK(log(i) - sum < positive + 1e-3);
            CHECK(sum - log(i) < negative + 1e-3);
        }
    }

    TEST_CASE("a threshold belongs to an event, not to a frame") {
        // The same ramp in one step and in 1000: equal draws, so equal events.
        CameraModel model;
        const auto ramp = [](double part) { return -3 + 2.5 * part; };
        EventCamera coarse(model, 1, 1);
        EventCamera fine(model, 1, 1);
        for (int i = 0; i <= 1000; ++i) {
            const std::vector<float> frame{intensity(ramp(i / 1000.0))};
            fine.see(frame, 10.0 * i);
            if (i % 1000 == 0) {
                coarse.see(frame, 10.0 * i);
            }
        }
        const Events a = coarse.take(0);
        const Events b = fine.take(0);
        REQUIRE(a.size() == b.size());
        CHECK(a.size() > 8);
        for (size_t i = 0; i < a.size(); ++i) {
            CHECK(std::abs(a.t[i] - b.t[i]) <= 1);
        }
    }

    TEST_CASE("equal seeds give equal events, sorted by time, row and column") {
        const auto run = [](uint64_t seed) {
            CameraModel model;
            model.seed = seed;
            model.noise_hz = 5;
            StillScene scene(waves(80, 70), moving(Path::linear, 6, 30), 40, 30, 20'000, 1, 1);
            EventCamera camera(model, 40, 30);
            expose(scene, camera, {0, 20'000}, 2);
            return camera.take(0);
        };
        const Events events = run(7);
        CHECK(events.size() > 1000);
        CHECK(equal(events, run(7)));
        CHECK_FALSE(equal(events, run(8)));
        for (size_t i = 1; i < events.size(); ++i) {
            const auto key = [&](size_t k) {
                return std::tie(events.t[k], events.y[k], events.x[k]);
            };
            REQUIRE(key(i - 1) <= key(i));
        }
        CHECK(events.t.front() >= 0);
        CHECK(events.t.back() <= 20'000);
    }

    TEST_CASE("drawn thresholds have the mean and spread asked for") {
        CameraModel model;
        model.positive = 0.3;
        model.sigma = 0.05;
        const int pixels = 10'000;
        EventCamera camera(model, pixels, 1);
        // A slow rise: the first event of a pixel tells its threshold.
        camera.see(std::vector<float>(pixels, intensity(-2)), 0);
        camera.see(std::vector<float>(pixels, intensity(-1.4)), 600'000);
        const Events events = camera.take(0);
        std::vector<double> first(pixels, 0);
        for (size_t i = 0; i < events.size(); ++i) {
            double& threshold = first[events.x[i]];
            threshold = threshold == 0 ? static_cast<double>(events.t[i]) * 1e-6 : threshold;
        }
        double sum = 0, squares = 0;
        for (const double threshold : first) {
            sum += threshold;
            squares += threshold * threshold;
        }
        const double mean = sum / pixels;
        CHECK(std::abs(mean - 0.3) < 0.003); // 6 standard errors
        CHECK(std::abs(std::sqrt(squares / pixels - mean * mean) - 0.05) < 0.0025);
    }

    TEST_CASE("pixels' own thresholds spread about the mean, and stay a pixel's own") {
        CameraModel model = ideal(0.1, 0.1);
        model.pixel_spread = 0.2;
        constexpr int pixels = 2000;
        EventCamera camera(model, pixels, 1);
        for (int i = 0; i <= 1; ++i) {
            camera.see(std::vector<float>(pixels, intensity(-4 + 4.0 * i)), 1000.0 * i);
        }
        std::vector<double> events(pixels);
        const Events seen = camera.take(0);
        for (const uint16_t x : seen.x) {
            ++events[x];
        }
        // 4 / (0.1 f) events, rounded down: f = 1 +- 0.2.
        double mean = 0;
        double square = 0;
        for (const double count : events) {
            const double factor = 40 / (count + 0.5);
            mean += factor / pixels;
            square += factor * factor / pixels;
        }
        CHECK(mean == doctest::Approx(1).epsilon(0.03));
        CHECK(std::sqrt(square - mean * mean) == doctest::Approx(0.2).epsilon(0.1));
        model.pixel_spread = 11;
        CHECK_THROWS_AS(EventCamera(model, 1, 1), Error);
    }

    TEST_CASE("a pixel is quiet for the refractory period") {
        CameraModel model = ideal(0.05, 0.05);
        model.noise_hz = 200;
        const auto log = [](double ms) { return -2 + std::sin(0.3 * ms); };
        const Events all = follow(model, 100, log);
        model.refractory_us = 3000;
        const Events some = follow(model, 100, log);
        CHECK(some.size() < all.size());
        CHECK(some.size() > 10);
        for (size_t i = 1; i < some.size(); ++i) {
            CHECK(some.t[i] - some.t[i - 1] >= 3000);
        }
    }

    TEST_CASE("a static scene gives noise at its rate, and nothing without") {
        const int side = 100;
        const std::vector<float> frame(side * side, 0.4F);
        const auto count = [&](double noise, double hot) {
            CameraModel model;
            model.noise_hz = noise;
            model.hot_fraction = hot;
            model.hot_hz = 100;
            EventCamera camera(model, side, side);
            for (int i = 0; i <= 10; ++i) {
                camera.see(frame, 50'000.0 * i);
            }
            return camera.take(0);
        };
        CHECK(count(0, 0).size() == 0);

        const Events noise = count(4, 0); // 10,000 pixels for 0.5 s: 20,000 +- 141
        CHECK(std::abs(static_cast<double>(noise.size()) - 20'000) < 850);
        const auto brighter = std::count(noise.p.begin(), noise.p.end(), 1);
        CHECK(std::abs(2.0 * static_cast<double>(brighter) - static_cast<double>(noise.size())) <
              850);
        const auto early =
            std::lower_bound(noise.t.begin(), noise.t.end(), 250'000) - noise.t.begin();
        CHECK(std::abs(static_cast<double>(early) - 10'000) < 600);

        const Events hot = count(0, 0.02); // 200 +- 14 pixels, 50 events each
        std::vector<int> pixels(side * side, 0);
        for (size_t i = 0; i < hot.size(); ++i) {
            ++pixels[static_cast<size_t>(hot.y[i]) * side + hot.x[i]];
        }
        const auto live = std::count_if(pixels.begin(), pixels.end(), [](int n) { return n > 0; });
        CHECK(std::abs(static_cast<double>(live) - 200) < 85);
        CHECK(std::abs(static_cast<double>(hot.size()) / static_cast<double>(live) - 50) < 5);
    }

    TEST_CASE("events keep microseconds on a clock that starts at 1.6e15") {
        EventCamera camera(ideal(), 2, 1);
        camera.see(std::vector<float>{0.1F, 0.1F}, 0);
        camera.see(std::vector<float>{0.1F, 0.9F}, 1000);
        const int64_t origin = 1'600'000'000'000'001;
        const Events events = camera.take(origin);
        REQUIRE(events.size() > 5);
        CHECK(events.t.front() >= origin);
        CHECK(events.t.back() <= origin + 1000);
        CHECK(std::adjacent_find(events.t.begin(), events.t.end()) == events.t.end());
        CHECK(camera.take(origin).size() == 0);
    }

    TEST_CASE("models and frames out of range are refused") {
        CHECK_THROWS_AS(EventCamera(ideal(0), 4, 4), Error);
        CHECK_THROWS_AS(EventCamera(ideal(0.2, -0.2), 4, 4), Error);
        CHECK_THROWS_AS(EventCamera(ideal(), 0, 4), Error);
        EventCamera camera(ideal(), 2, 2);
        camera.see(std::vector<float>(4), 10);
        CHECK_THROWS_AS(camera.see(std::vector<float>(3), 20), std::invalid_argument);
        CHECK_THROWS_AS(camera.see(std::vector<float>(4), 5), std::invalid_argument);
        CHECK_THROWS_AS(Trajectory(moving(Path::linear, -1), 1), Error);
        CHECK_THROWS_AS(Trajectory(moving(Path::linear, 1, 0, 0, 0), 1), Error);
        CHECK_THROWS_AS(StillScene(waves(20, 20), Motion{}, 21, 20, 1000, 1, 1), Error);
    }
}
