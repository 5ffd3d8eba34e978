#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "layers/deblur.hpp"
#include "layers/operations.hpp"
#include "tests/fixture.hpp"

// What of an image moves, and that computing no more than that changes nothing.
namespace {

using namespace ecir;
using ecir::test::code_of;

constexpr Exposure kExposure{0, 50'000};

/// Events of noise, `rate` a pixel.
Events noise(uint32_t width, uint32_t height, double rate, uint32_t seed) {
    CaseRandom random(seed);
    std::vector<int64_t> times(static_cast<size_t>(rate * width * height));
    std::ranges::generate(times, [&] { return int64_t{random.integer(0, 50'000)}; });
    std::ranges::sort(times);
    Events events;
    for (const int64_t t : times) {
        events.push_back(t, static_cast<uint16_t>(random.integer(0, width - 1)),
                         static_cast<uint16_t>(random.integer(0, height - 1)),
                         static_cast<uint8_t>(random.integer(0, 1)));
    }
    return events;
}

/// A textured square that moves over a background that does not.
struct Scene {
    uint32_t width;
    uint32_t height;
    std::vector<float> blurry;
    Events events;

    /// side, left, top: of the square at the exposure's start; it moves by `travel` to the right.
    Scene(uint32_t wide, uint32_t high, uint32_t side, uint32_t left, uint32_t top, double travel)
        : width(wide), height(high), blurry(size_t{wide} * high) {
        constexpr int kSteps = 100;
        constexpr double kThreshold = 0.2;
        std::vector<double> level(blurry.size());
        for (int step = 0; step <= kSteps; ++step) {
            for (uint32_t y = 0; y < height; ++y) {
                for (uint32_t x = 0; x < width; ++x) {
                    const size_t at = size_t{y} * width + x;
                    const double u = x - left - travel * step / kSteps;
                    const double v = double(y) - top;
                    const bool inside = u >= 0 && u < side && v >= 0 && v < side;
                    const double value = inside ? 0.5 + 0.3 * std::sin(u * 0.6) * std::cos(v * 0.4)
                                                : 0.5 + 0.2 * std::sin(x * 0.3 + y * 0.2);
                    blurry[at] += static_cast<float>(value / (kSteps + 1));
                    const double now = std::log(value);
                    level[at] = step == 0 ? now : level[at];
                    while (std::abs(now - level[at]) >= kThreshold) {
                        const bool brighter = now > level[at];
                        level[at] += brighter ? kThreshold : -kThreshold;
                        events.push_back(step * kExposure.end / kSteps, static_cast<uint16_t>(x),
                                         static_cast<uint16_t>(y), brighter ? 1 : 0);
                    }
                }
            }
        }
    }
};

double largest_difference(const std::vector<float>& a, const std::vector<float>& b) {
    double largest = a.size() == b.size() ? 0 : INFINITY;
    for (size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
        largest = std::max(largest, std::abs(double{a[i]} - b[i]));
    }
    return largest;
}

ActivityMap map_of(uint32_t width, uint32_t height,
                   std::initializer_list<std::pair<uint32_t, uint32_t>> cells) {
    ActivityMap map(width, height);
    for (const auto& [column, row] : cells) {
        map.active[size_t{row} * map.columns + column] = 1;
    }
    return map;
}

} // namespace

TEST_SUITE("regions") {
    TEST_CASE(
        "noise moves nothing, at 0.1 to 12 events a second and pixel, and hot pixels nothing") {
        for (const double rate : {0.005, 0.05, 0.2, 0.6}) {
            CAPTURE(rate);
            double share = 0;
            for (uint32_t seed = 0; seed < 4; ++seed) {
                const Events events = noise(640, 480, rate, seed);
                share += moving_cells(events.view(), kExposure, 640, 480).share() / 4;
            }
            CHECK(share < 0.0005);
        }
        Events events = noise(640, 480, 0.02, 5);
        Events hot;
        for (size_t i = 0; i < events.size(); ++i) {
            hot.push_back(events.t[i], events.x[i], events.y[i], 1);
            for (uint16_t k = 0; k < 5; ++k) {
                hot.push_back(events.t[i], static_cast<uint16_t>(100 * k + 7), 77, 1);
            }
        }
        CHECK(moving_cells(hot.view(), kExposure, 640, 480).share() == 0);
    }

    TEST_CASE("a moving square is found to the cell, in noise as well") {
        const Scene scene(320, 240, 40, 100, 90, 12);
        for (const double rate : {0.0, 0.05, 0.3}) {
            CAPTURE(rate);
            // Merged by time.
            const Events grains = noise(320, 240, rate, 3);
            std::vector<std::pair<int64_t, size_t>> order;
            for (size_t i = 0; i < scene.events.size() + grains.size(); ++i) {
                order.emplace_back(i < scene.events.size() ? scene.events.t[i]
                                                           : grains.t[i - scene.events.size()],
                                   i);
            }
            std::ranges::sort(order);
            Events all;
            for (const auto& [t, i] : order) {
                const bool real = i < scene.events.size();
                const Events& from = real ? scene.events : grains;
                const size_t k = real ? i : i - scene.events.size();
                all.push_back(t, from.x[k], from.y[k], from.p[k]);
            }
            const ActivityMap map = moving_cells(all.view(), kExposure, 320, 240);
            for (uint32_t row = 0; row < map.rows; ++row) {
                for (uint32_t column = 0; column < map.columns; ++column) {
                    CAPTURE(column);
                    CAPTURE(row);
                    // The square and its way cover x 100 to 152, y 90 to 130.
                    const bool near = column >= 5 && column <= 10 && row >= 4 && row <= 9;
                    const bool inside = column >= 6 && column <= 8 && row >= 6 && row <= 7;
                    CHECK((!inside || map.at(column, row)));
                    CHECK((near || !map.at(column, row)));
                }
            }
        }
    }

    TEST_CASE(
        "windows hold their cells with the context, start on the grid, and end with the image") {
        const RegionRule rule{40, 8};
        const auto check = [&](uint32_t width, uint32_t height, const ActivityMap& map) {
            Regions regions = find_regions(map, rule, width, height);
            for (const auto& [computed, kept] : regions.windows) {
                CHECK(computed.left % window_grid == 0);
                CHECK(computed.top % window_grid == 0);
                CHECK((computed.right == width || computed.width() % window_step == 0));
                CHECK((computed.bottom == height || computed.height() % window_step == 0));
                CHECK(computed.right <= width);
                CHECK(computed.bottom <= height);
                CHECK((computed.left == 0 || computed.left + rule.context <= kept.left));
                CHECK((computed.right == width || computed.right >= kept.right + rule.context));
                CHECK((computed.top == 0 || computed.top + rule.context <= kept.top));
                CHECK((computed.bottom == height || computed.bottom >= kept.bottom + rule.context));
            }
            // Every pixel that counts is kept, and fully in active cells.
            for (uint32_t y = 0; y < height && !regions.weight.empty(); ++y) {
                for (uint32_t x = 0; x < width; ++x) {
                    const float weight = regions.weight[size_t{y} * width + x];
                    const bool kept = std::ranges::any_of(regions.windows, [&](const Window& each) {
                        return each.kept.contains(x, y);
                    });
                    REQUIRE((weight == 0 || kept));
                    REQUIRE((weight == 1) == map.at(x / activity_cell, y / activity_cell));
                }
            }
            return regions;
        };
        CHECK(check(640, 480, ActivityMap(640, 480)).windows.empty());
        const Regions single = check(640, 480, map_of(640, 480, {{20, 10}}));
        REQUIRE(single.windows.size() == 1);
        CHECK(single.windows[0].kept == PixelRect{312, 152, 344, 184});
        CHECK(single.windows[0].computed == PixelRect{272, 112, 384, 224});
        CHECK(single.weight[160 * 640 + 319] == doctest::Approx(64.0 / 81));
        CHECK(single.weight[160 * 640 + 312] == doctest::Approx(1.0 / 81));
        CHECK(single.weight[160 * 640 + 311] == 0);
        // Neighbours and near ones become one window, far ones do not.
        CHECK(check(640, 480, map_of(640, 480, {{20, 10}, {21, 11}, {24, 12}})).windows.size() ==
              1);
        CHECK(check(640, 480, map_of(640, 480, {{3, 3}, {36, 25}})).windows.size() == 2);
        // Sizes that are no multiples of anything, corners.
        CHECK(check(637, 475, map_of(637, 475, {{0, 0}, {39, 29}, {39, 0}})).windows.size() == 3);
        // Nearly everything, and images too small to gain.
        ActivityMap most(640, 480);
        std::fill(most.active.begin(), most.active.end() - ptrdiff_t{4} * most.columns, uint8_t{1});
        CHECK(find_regions(most, rule, 640, 480).whole(640, 480));
        CHECK(find_regions(most, rule, 640, 480).weight.empty());
        CHECK(find_regions(map_of(64, 48, {{1, 1}}), rule, 64, 48).whole(64, 48));
    }

    TEST_CASE("computing only what moves gives the frames of the whole within 0.1 grey levels") {
        const auto device = Device::open();
        const Scene scene(384, 272, 36, 60, 70, 14);
        for (const char* model : {"edi", "fusion", "ecir"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            const auto times = even_times(2);
            Deblur part(device, options, scene.width, scene.height);
            const auto frames = part.frames(scene.blurry, scene.events.view(), kExposure, times);
            REQUIRE(part.windows().size() == 1);
            CHECK(part.windows()[0].area() < scene.blurry.size() / 2);
            CHECK(part.active_share() < 0.1);
            options.regions = false;
            Deblur all(device, options, scene.width, scene.height);
            const auto whole = all.frames(scene.blurry, scene.events.view(), kExposure, times);
            REQUIRE(all.windows().size() == 1);
            CHECK(all.windows()[0].area() == scene.blurry.size());
            CHECK(all.active_share() == part.active_share());
            CHECK(all.thresholds() == part.thresholds());
            const double difference = 255 * largest_difference(frames, whole);
            MESSAGE(std::string(model), ": largest difference ", difference, " grey levels");
            CHECK(difference < 0.1);
            // It did something, and nothing far away.
            CHECK(largest_difference(frames, scene.blurry) > 0.1);
            for (uint32_t y = 0; y < scene.height; ++y) {
                const size_t row = size_t{y} * scene.width;
                const auto still = std::span(scene.blurry).subspan(row + 200, 184);
                CHECK(std::ranges::equal(std::span(frames).subspan(row + 200, 184), still));
            }
        }
    }

    TEST_CASE("fusion does so where things move far, whose pixels come from far away") {
        const auto device = Device::open();
        const Scene scene(592, 336, 72, 130, 130, 60);
        DeblurOptions options;
        options.model = "fusion-small";
        options.thresholds = EdiThresholds{0.2F, 0.2F};
        const std::vector<double> times{-1.0, 0.4, 1.0};
        Deblur part(device, options, scene.width, scene.height);
        const auto frames = part.frames(scene.blurry, scene.events.view(), kExposure, times);
        REQUIRE(part.windows().size() == 1);
        CHECK(part.windows()[0].area() < scene.blurry.size());
        options.regions = false;
        Deblur all(device, options, scene.width, scene.height);
        const auto whole = all.frames(scene.blurry, scene.events.view(), kExposure, times);
        const double difference = 255 * largest_difference(frames, whole);
        MESSAGE("largest difference ", difference, " grey levels");
        CHECK(difference < 0.1);
    }

    TEST_CASE("noise alone leaves the blurry frame as it is") {
        const Scene scene(128, 96, 0, 0, 0, 0);
        const Events events = noise(128, 96, 0.05, 9);
        Deblur deblur(Device::open(), {}, 128, 96);
        CHECK(deblur.frames(scene.blurry, events.view(), kExposure, std::vector{0.3}) ==
              scene.blurry);
        CHECK(deblur.active_share() == 0);
        CHECK(deblur.windows().empty());
        CHECK(!deblur.thresholds());
    }

    TEST_CASE(
        "windows of many sizes and places, two frames under way, give the bits of one alone") {
        const auto device = Device::open();
        std::vector<Scene> scenes;
        for (const auto& [side, left, top] : std::vector<std::array<uint32_t, 3>>{
                 {20, 10, 10}, {20, 150, 100}, {60, 30, 40}, {20, 10, 10}, {90, 100, 60}}) {
            scenes.emplace_back(288, 224, side, left, top, 10);
        }
        // Two at a time, of one size.
        const Scene other(288, 224, 20, 230, 170, 10);
        Scene& two = scenes[1];
        two = Scene(288, 224, 20, 10, 10, 10);
        Events both;
        for (size_t i = 0, k = 0; i < two.events.size() || k < other.events.size();) {
            const bool first = k == other.events.size() ||
                               (i < two.events.size() && two.events.t[i] <= other.events.t[k]);
            const Events& from = first ? two.events : other.events;
            size_t& at = first ? i : k;
            both.push_back(from.t[at], from.x[at], from.y[at], from.p[at]);
            ++at;
        }
        two.events = both;
        for (const char* model : {"edi", "ecir"}) {
            CAPTURE(model);
            DeblurOptions options;
            options.model = model;
            std::vector<std::vector<float>> expected;
            Deblur one(device, options, 288, 224);
            for (const Scene& scene : scenes) {
                expected.push_back(one.frames(scene.blurry, scene.events.view(), kExposure,
                                              std::vector{0.5, -0.5}));
                // E-CIR's context leaves no room between the two.
                const bool apart = &scene == &two && options.model == "edi";
                CHECK(one.windows().size() == (apart ? 2 : 1));
            }
            Deblur deblur(device, options, 288, 224);
            const uint64_t pixels = uint64_t{288} * 224;
            const std::vector<double> many(device->info().heap_bytes / (4 * pixels) * 64, 0.5);
            for (size_t i = 0; i <= scenes.size(); ++i) {
                if (i < scenes.size()) {
                    deblur.begin(scenes[i].blurry, scenes[i].events.view(), kExposure,
                                 std::vector{0.5, -0.5});
                    // One that cannot begin changes nothing.
                    CHECK(code_of([&] {
                              deblur.begin(two.blurry, two.events.view(), kExposure, many);
                          }) == ExitCode::resources);
                }
                if (i > 0) {
                    CAPTURE(i);
                    CHECK(deblur.finish() == expected[i - 1]);
                }
            }
        }
    }
}
