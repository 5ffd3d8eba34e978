#include <doctest/doctest.h>

#include "layers/event_pack.hpp"
#include "layers/reference/histogram.hpp"
#include "runtime/error.hpp"

using namespace ecir;

namespace {

Events some_events(std::initializer_list<int64_t> times) {
    Events events;
    for (const int64_t t : times) {
        events.push_back(t, 0, 0, 1);
    }
    return events;
}

} // namespace

TEST_SUITE("events") {
    TEST_CASE("the window includes both ends of the exposure") {
        const Events events = some_events({9, 10, 10, 15, 20, 20, 21});
        CHECK(window(events.view(), {10, 20}).size() == 5);
        CHECK(window(events.view(), {11, 14}).size() == 0);
        CHECK(window(events.view(), {22, 30}).size() == 0);
    }

    TEST_CASE("events are packed by pixel and stay in time order within one") {
        constexpr int64_t origin = 1'600'000'000'000'000;
        Events events;
        events.push_back(origin, 1, 0, 1);
        events.push_back(origin + 25, 0, 1, 0);
        events.push_back(origin + 50, 1, 0, 0);
        events.push_back(origin + 50, 1, 0, 1);
        events.push_back(origin + 100, 2, 1, 1);
        const PackedEvents packed = pack_events(events.view(), {origin, origin + 100}, 3, 2);
        constexpr uint32_t on = uint32_t{1} << 31;
        CHECK(packed.duration == 100);
        CHECK(packed.offset == std::vector<uint32_t>{0, 0, 3, 3, 4, 4, 5});
        CHECK(packed.mark == std::vector<uint32_t>{on | 0, 2, on | 3, 1, on | 4});
        CHECK(packed.tick == std::vector<int32_t>{0, 50, 50, 25, 100});
        CHECK(packed.time == std::vector<float>{-1, 0, 0, -0.5F, 1});
        CHECK(release_times(packed) == std::vector<float>{0, 0.5F, 0.5F, 0.25F, 1});
    }

    TEST_CASE("packing keeps every event once") {
        CaseRandom random(1);
        const Exposure exposure{-70000, 50000};
        const Events events = random_events(random, exposure, 13, 7, 4000, 20);
        const PackedEvents packed = pack_events(events.view(), exposure, 13, 7);
        REQUIRE(packed.size() == events.size());
        REQUIRE(packed.offset.back() == events.size());
        std::vector<bool> seen(events.size());
        for (uint32_t pixel = 0; pixel < 13 * 7; ++pixel) {
            for (uint32_t e = packed.offset[pixel]; e < packed.offset[pixel + 1]; ++e) {
                const uint32_t ordinal = packed.mark[e] & 0x7FFFFFFFU;
                REQUIRE(!seen[ordinal]);
                seen[ordinal] = true;
                REQUIRE(events.y[ordinal] * 13U + events.x[ordinal] == pixel);
                REQUIRE((packed.mark[e] >> 31) == events.p[ordinal]);
                REQUIRE(packed.tick[e] == events.t[ordinal] - exposure.start);
                REQUIRE(
                    (e == packed.offset[pixel] || ordinal > (packed.mark[e - 1] & 0x7FFFFFFFU)));
            }
        }
    }

    TEST_CASE("no events, and events at one time only") {
        const PackedEvents none = pack_events({}, {0, 10}, 2, 2);
        CHECK(none.offset == std::vector<uint32_t>(5, 0));
        CHECK(release_times(none).empty());
        const Events same = some_events({4, 4, 4});
        CHECK(release_times(pack_events(same.view(), {0, 10}, 1, 1)) ==
              std::vector<float>(3, 0.0F));
    }

    TEST_CASE("what cannot be packed is refused") {
        const Events good = some_events({1, 2});
        CHECK_NOTHROW(pack_events(good.view(), {0, longest_exposure_us}, 1, 1));
        CHECK_THROWS_AS(pack_events(good.view(), {0, longest_exposure_us + 1}, 1, 1), Error);
        CHECK_THROWS_AS(pack_events(good.view(), {INT64_MIN, INT64_MAX}, 1, 1), Error);
        CHECK_THROWS_AS(pack_events(good.view(), {5, 5}, 1, 1), Error);
        CHECK_THROWS_AS(pack_events(good.view(), {2, 10}, 1, 1), Error);
        CHECK_THROWS_AS(pack_events(some_events({2, 1}).view(), {0, 10}, 1, 1), Error);
        Events outside;
        outside.push_back(1, 0, 3, 1);
        CHECK_THROWS_AS(pack_events(outside.view(), {0, 10}, 4, 3), Error);
    }
}
