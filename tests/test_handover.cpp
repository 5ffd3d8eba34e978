#include <doctest/doctest.h>

#include <atomic>
#include <memory>
#include <stdexcept>
#include <thread>
#include <vector>

#include "tools/ecir/handover.hpp"

using ecir::cli::Handover;

TEST_SUITE("handover") {
    TEST_CASE("items arrive in order, and never more than agreed wait") {
        Handover<std::unique_ptr<int>> items(2);
        std::atomic<int> put{0};
        std::jthread producer([&] {
            for (int i = 0; i < 1000; ++i) {
                items.put(std::make_unique<int>(i));
                ++put;
            }
            items.close();
        });
        for (int i = 0; i < 1000; ++i) {
            const auto item = items.take();
            REQUIRE(item.has_value());
            CHECK(**item == i);
            CHECK(put <= i + 3);
        }
        CHECK(!items.take().has_value());
    }

    TEST_CASE("an error comes behind what was put before it") {
        Handover<int> items(3);
        items.put(1);
        items.put(2);
        items.close(std::make_exception_ptr(std::runtime_error("broken")));
        CHECK(items.take() == 1);
        CHECK(items.take() == 2);
        CHECK_THROWS_WITH_AS(items.take(), "broken", std::runtime_error);
    }

    TEST_CASE("who waits to put is let go when nobody takes any more") {
        Handover<int> items(1);
        CHECK(items.put(1));
        bool kept = true;
        std::jthread producer([&] { kept = items.put(2); });
        items.abandon();
        producer.join();
        CHECK(!kept);
        CHECK(!items.put(3));
    }
}
