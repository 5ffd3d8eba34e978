#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "layers/scene_facts.hpp"
#include "layers/travel.hpp"

using namespace ecir;

namespace {

constexpr uint32_t kWidth = 96;
constexpr uint32_t kHeight = 64;
constexpr Exposure kExposure{1'600'000'000'000'000, 1'600'000'000'120'000};

constexpr TravelRange kServed{2, 80};

struct Seen {
    std::vector<float> blurry;
    Events events;
    [[nodiscard]] SceneFacts facts() const {
        return scene_facts(blurry, events.view(), kExposure, kWidth, kHeight);
    }
};

bool warned(const SceneFacts& facts, const std::string& name) {
    return std::ranges::any_of(scene_warnings(facts, kServed), [&](const SceneWarning& warning) {
        return warning.name == name && !warning.text.empty();
    });
}

/// ESIM with thresholds of 0.2 on an intensity of column, row and time in 0 ... 1.
Seen see(const std::function<double(double, double, double)>& intensity) {
    constexpr int kSteps = 240;
    constexpr double kThreshold = 0.2;
    Seen seen{std::vector<float>(size_t{kWidth} * kHeight), {}};
    std::vector<double> level(seen.blurry.size(), 1e9);
    for (int step = 0; step <= kSteps; ++step) {
        const double time = static_cast<double>(step) / kSteps;
        const auto stamp = kExposure.start +
                           static_cast<int64_t>(time * static_cast<double>(kExposure.duration()));
        for (uint32_t y = 0; y < kHeight; ++y) {
            for (uint32_t x = 0; x < kWidth; ++x) {
                const size_t i = size_t{y} * kWidth + x;
                const double value = intensity(x, y, time);
                seen.blurry[i] += static_cast<float>(value / (kSteps + 1));
                const double now = std::log(value + 0.01);
                level[i] = step == 0 ? now : level[i];
                for (; std::abs(now - level[i]) >= kThreshold;
                     level[i] += now > level[i] ? kThreshold : -kThreshold) {
                    seen.events.push_back(stamp, static_cast<uint16_t>(x), static_cast<uint16_t>(y),
                                          now > level[i] ? 1 : 0);
                }
            }
        }
    }
    return seen;
}

/// A texture with gradients in all directions.
double texture(double x, double y) {
    return 0.4 + 0.15 * std::sin(0.5 * x) + 0.15 * std::sin(0.45 * y + 0.2 * x);
}

Seen moving(double travel) {
    return see([=](double x, double y, double time) {
        return texture(x - 0.8 * travel * time, y - 0.6 * travel * time);
    });
}

Seen lit_by(const std::function<double(double)>& light) {
    return see([&](double x, double y, double time) { return texture(x, y) * light(time); });
}

} // namespace

TEST_SUITE("scene facts") {
    TEST_CASE("travel is that of the motion, slow and fast, straight and back again") {
        for (const double travel : {5.0, 12.0, 30.0}) {
            CAPTURE(travel);
            const SceneFacts facts = moving(travel).facts();
            CHECK(facts.travel > 0.7 * travel);
            CHECK(facts.travel < 1.3 * travel);
            CHECK(scene_warnings(facts, kServed).empty());
        }
        const Seen shaken = see([](double x, double y, double time) {
            return texture(x - 10 * std::abs(2 * time - 1), y);
        });
        CHECK(shaken.facts().travel == doctest::Approx(20).epsilon(0.3));
    }

    TEST_CASE("late events, where what moves goes far in that time") {
        SceneFacts facts;
        facts.travel = 12;
        const double pixel = static_cast<double>(kExposure.duration()) / 12;
        CHECK_FALSE(lag_warning(facts, kExposure, pixel).has_value());
        for (const double late : {2 * pixel, -2 * pixel}) {
            const auto warning = lag_warning(facts, kExposure, late);
            REQUIRE(warning.has_value());
            CHECK(warning->name == "late");
        }
    }

    TEST_CASE("motion beyond what a method is good for") {
        const SceneFacts facts = moving(12).facts();
        const auto names = [&](const TravelRange& served) {
            std::string all;
            for (const SceneWarning& warning : scene_warnings(facts, served)) {
                all += warning.name + ' ';
            }
            return all;
        };
        CHECK(names({}).empty());
        CHECK(names({20, 80}) == "slow ");
        CHECK(names({0, 5}) == "fast ");
    }

    TEST_CASE("travel at a size that is binned") {
        const Seen seen = moving(12);
        // Each pixel three times in each direction: three times the travel.
        constexpr uint32_t kScale = 3;
        std::vector<float> blurry(seen.blurry.size() * kScale * kScale);
        for (size_t i = 0; i < blurry.size(); ++i) {
            const size_t x = i % (kWidth * kScale) / kScale;
            const size_t y = i / (kWidth * kScale) / kScale;
            blurry[i] = seen.blurry[y * kWidth + x];
        }
        Events events;
        for (size_t i = 0; i < seen.events.size(); ++i) {
            for (uint32_t part = 0; part < kScale * kScale; ++part) {
                events.push_back(seen.events.t[i],
                                 static_cast<uint16_t>(seen.events.x[i] * kScale + part % kScale),
                                 static_cast<uint16_t>(seen.events.y[i] * kScale + part / kScale),
                                 seen.events.p[i]);
            }
        }
        const double travel =
            estimate_travel(blurry, events.view(), kExposure, kWidth * kScale, kHeight * kScale);
        CHECK(travel == doctest::Approx(36).epsilon(0.3));
    }

    TEST_CASE("nothing seen") {
        const SceneFacts facts = Seen{std::vector<float>(kWidth * kHeight, 0.5F), {}}.facts();
        CHECK(facts.events == 0);
        CHECK(facts.travel == 0);
        CHECK(warned(facts, "no-events"));
        CHECK(scene_warnings(facts, kServed).size() == 1);
    }

    TEST_CASE("shares count pixels and events") {
        Seen seen{std::vector<float>(kWidth * kHeight, 0.5F), {}};
        std::fill_n(seen.blurry.begin(), kWidth * kHeight / 4, 1.0F);
        for (uint16_t i = 0; i < 40; ++i) { // ten pixels far apart, four events each
            seen.events.push_back(kExposure.start + i, static_cast<uint16_t>(i % 10 * 9 + 2), 20,
                                  i % 4 == 0 ? 0 : 1);
        }
        const SceneFacts facts = seen.facts();
        CHECK(facts.white_share == doctest::Approx(0.25));
        CHECK(facts.black_share == 0);
        CHECK(facts.active_share == doctest::Approx(10.0 / (kWidth * kHeight)));
        CHECK(facts.positive_share == doctest::Approx(0.75));
        CHECK(facts.isolated_share == 1);
        CHECK(warned(facts, "saturated"));
        CHECK(warned(facts, "noise"));
    }

    TEST_CASE("noise so dense that no event is without a neighbour") {
        const Seen scene = moving(12);
        CHECK(scene.facts().agreeing_share > 0.75);
        CHECK_FALSE(warned(scene.facts(), "noise"));
        Seen noisy = see([](double x, double y, double) { return texture(x, y); });
        std::mt19937 random(5);
        for (uint32_t i = 0; i < 2 * kWidth * kHeight; ++i) {
            noisy.events.push_back(kExposure.start + i, static_cast<uint16_t>(random() % kWidth),
                                   static_cast<uint16_t>(random() % kHeight),
                                   static_cast<uint8_t>(random() % 2));
        }
        const SceneFacts facts = noisy.facts();
        CHECK(facts.agreeing_share == doctest::Approx(0.5).epsilon(0.05));
        CHECK(facts.isolated_share < 0.3);
        CHECK(warned(facts, "noise"));
    }

    TEST_CASE("lamps that flicker, light that grows") {
        for (const double hertz : {100.0, 120.0}) {
            CAPTURE(hertz);
            const SceneFacts flicker =
                lit_by([&](double time) {
                    return 1 + 0.4 * std::sin(2 * std::numbers::pi * hertz * 0.12 * time);
                }).facts();
            CHECK(flicker.flicker_hz == hertz);
            CHECK(warned(flicker, "flicker"));
        }
        const SceneFacts grows = lit_by([](double time) { return 0.6 + time; }).facts();
        CHECK(warned(grows, "one-sign"));
        CHECK_FALSE(warned(grows, "flicker"));
    }

    TEST_CASE("hot pixels") {
        Seen seen = moving(12);
        Events hot;
        for (int i = 0; i < 400; ++i) {
            for (uint16_t pixel = 0; pixel < 8; ++pixel) {
                hot.push_back(kExposure.start + i * 300, static_cast<uint16_t>(10 + 9 * pixel), 30,
                              1);
            }
        }
        Events all = seen.events;
        for (size_t i = 0; i < hot.size(); ++i) {
            all.push_back(hot.t[i], hot.x[i], hot.y[i], 1);
        }
        std::vector<size_t> order(all.size());
        for (size_t i = 0; i < order.size(); ++i) {
            order[i] = i;
        }
        std::ranges::stable_sort(order, {}, [&](size_t i) { return all.t[i]; });
        seen.events = {};
        for (const size_t i : order) {
            seen.events.push_back(all.t[i], all.x[i], all.y[i], all.p[i]);
        }
        CHECK(seen.facts().hot_pixels == 8);
        CHECK(warned(seen.facts(), "hot-pixels"));
    }

    TEST_CASE("times that are bunched, by a coarse clock and by a bus that stands still") {
        const Seen even = moving(30); // in 240 steps
        const auto stamped = [&](const std::function<int64_t(int64_t)>& clock) {
            Seen seen = even;
            for (int64_t& time : seen.events.t) {
                time = kExposure.start + clock(time - kExposure.start);
            }
            return seen.facts();
        };
        CHECK(even.facts().bunched_share < 0.05);
        CHECK_FALSE(warned(even.facts(), "bunched"));
        const SceneFacts coarse = stamped([](int64_t t) { return t / 6000 * 6000; });
        CHECK(coarse.bunched_share > 0.25); // 5 of 21
        CHECK(warned(coarse, "bunched"));
        CHECK_FALSE(warned(coarse, "gap"));
        const SceneFacts late =
            stamped([](int64_t t) { return t > 30'000 && t < 60'000 ? 60'000 : t; });
        CHECK(late.bunched_share > 0.2);
        CHECK(warned(late, "bunched"));
        CHECK(stamped([](int64_t) { return 7; }).bunched_share == 1);
        // Few events, or no room for many times, tell nothing.
        const Seen few{even.blurry, [&] {
                           Events first;
                           for (size_t i = 0; i < 150; ++i) {
                               first.push_back(kExposure.start, even.events.x[i], even.events.y[i],
                                               1);
                           }
                           return first;
                       }()};
        CHECK(few.facts().bunched_share == 0);
        CHECK(bunched_share(even.events.view(), {0, 900}) == 0);
    }

    TEST_CASE("a bus that drops events leaves a gap") {
        Seen seen = moving(30);
        CHECK(seen.facts().longest_gap == 0);
        const int64_t from = kExposure.start + 40'000;
        Events kept;
        for (size_t i = 0; i < seen.events.size(); ++i) {
            if (seen.events.t[i] < from || seen.events.t[i] > from + 9'000) {
                kept.push_back(seen.events.t[i], seen.events.x[i], seen.events.y[i],
                               seen.events.p[i]);
            }
        }
        seen.events = kept;
        CHECK(seen.facts().longest_gap >= 9'000);
        CHECK(warned(seen.facts(), "gap"));
    }
}
