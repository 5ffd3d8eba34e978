#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "layers/edi.hpp"
#include "layers/edi_threshold.hpp"
#include "layers/reference/edi.hpp"
#include "runtime/error.hpp"

using namespace ecir;

namespace {

Device& device() {
    static const std::shared_ptr<Device> opened = Device::open();
    return *opened;
}

struct Event {
    uint32_t pixel;
    float time;
    bool positive;
};

/// Sorts by pixel, keeping the order of events of one pixel.
PackedEvents pack(std::vector<Event> events, uint32_t pixels) {
    std::ranges::stable_sort(events, {}, &Event::pixel);
    PackedEvents packed;
    packed.offset.assign(pixels + 1, 0);
    for (const Event& event : events) {
        ++packed.offset[event.pixel + 1];
        packed.mark.push_back(static_cast<uint32_t>(event.positive) << 31 |
                              static_cast<uint32_t>(packed.mark.size()));
        packed.time.push_back(event.time);
    }
    std::partial_sum(packed.offset.begin(), packed.offset.end(), packed.offset.begin());
    return packed;
}

/// Frames of one row of pixels, [times][pixels].
std::vector<float> frames(const std::vector<float>& blurry, const PackedEvents& events,
                          const std::vector<double>& times, const EdiThresholds& thresholds) {
    const auto width = static_cast<uint32_t>(blurry.size());
    const auto count = std::max(1U, static_cast<uint32_t>(events.size()));
    Program program(device());
    EdiInput input;
    input.offsets = program.input({1, 1, width + 1});
    input.times = program.input({1, 1, count});
    input.marks = program.input({1, 1, count});
    input.blurry = program.input({1, 1, width});
    input.thresholds = program.input({1, 1, 2});
    const auto d = static_cast<uint32_t>(times.size());
    const Tensor schedule = program.input({1, 2, d});
    const Tensor busy = program.input({1, 1, edi_busy_length(count)});
    const Tensor output = program.output({d, 1, width});
    record_edi(program, input, schedule, busy, output);
    program.finish();
    program.write(input.offsets, events.offset);
    program.write(input.times, events.time);
    program.write(input.marks, events.mark);
    program.write(input.blurry, blurry);
    program.write(input.thresholds, std::vector<float>{thresholds.positive, thresholds.negative});
    program.write(schedule, edi_schedule(times));
    program.write(busy, edi_busy_pixels(events));
    program.run();
    const auto result = program.read(output);
    return {result.begin(), result.end()};
}

/// ln(L + 0.01) of a texture with detail at several scales, one value a place.
double texture(double x, double y) {
    double sum = 0;
    double size = 0.55;
    for (int octave = 0; octave < 5; ++octave) {
        const double f = 0.055 * std::pow(1.9, octave);
        const double turn = 1.1 * octave;
        const double u = x * std::cos(turn) + y * std::sin(turn);
        const double v = y * std::cos(turn) - x * std::sin(turn);
        sum += size * std::tanh(1.5 * std::sin(f * u + 2 * std::sin(0.7 * f * v))) *
               std::cos(0.8 * f * v + octave);
        size *= 0.72;
    }
    return -1.2 + 0.8 * sum;
}

struct Scene {
    uint32_t width, height;
    std::vector<float> blurry;
    PackedEvents events;
};

/// What an ideal event camera with noisy thresholds sees of the texture under a curved motion of
/// about `travel` pixels.
Scene simulate(uint32_t width, uint32_t height, double travel, const EdiThresholds& thresholds,
               uint64_t seed) {
    constexpr int steps = 200;
    CaseRandom random(seed);
    const auto noisy = [&](float threshold) {
        double sum = 0; // close to a normal distribution of deviation 0.03
        for (int i = 0; i < 12; ++i) {
            sum += random.uniform(-0.5, 0.5);
        }
        return std::max(0.02, double{threshold} + 0.03 * sum);
    };
    Scene scene{width, height, std::vector<float>(size_t{width} * height), {}};
    std::vector<Event> events;
    for (uint32_t p = 0; p < width * height; ++p) {
        double reference = 0;
        double up = noisy(thresholds.positive);
        double down = noisy(thresholds.negative);
        double sum = 0;
        for (int i = 0; i <= steps; ++i) {
            const double t = 2.0 * i / steps - 1;
            const double value =
                texture(p % width + travel / 2 * t, p / width + travel / 5 * t * t);
            reference = i == 0 ? value : reference;
            sum += (i == 0 || i == steps ? 0.5 : 1.0) * (std::exp(value) - 0.01);
            for (; value - reference >= up; up = noisy(thresholds.positive)) {
                reference += up;
                events.push_back({p, static_cast<float>(t), true});
            }
            for (; reference - value >= down; down = noisy(thresholds.negative)) {
                reference -= down;
                events.push_back({p, static_cast<float>(t), false});
            }
        }
        scene.blurry[p] =
            static_cast<float>(std::round(255 * std::clamp(sum / steps, 0.0, 1.0)) / 255);
    }
    scene.events = pack(std::move(events), width * height);
    return scene;
}

EdiThresholds estimate(const Scene& scene) {
    EdiThresholdEstimator estimator(device(), scene.width, scene.height);
    return estimator.estimate(scene.events, scene.blurry).thresholds;
}

} // namespace

TEST_SUITE("edi") {
    TEST_CASE("kernels agree with the reference") {
        for (const Operation& operation :
             {Operation{"edi", 1e-5, "", 10, edi_trial},
              Operation{"edi_moments", 1e-5, "", 4, edi_moments_trial}}) {
            for (uint32_t trial = 0; trial < operation.trials; ++trial) {
                const TrialResult result = run_trial(operation, device(), trial);
                INFO(operation.name, " ", result.shape, ": error ", result.error);
                CHECK(result.ok);
            }
        }
    }

    TEST_CASE("a pixel without events keeps the blurry value") {
        const auto result = frames({0, 0.25F, 1}, pack({}, 3), {-1, 0.3, 1}, {0.2F, 0.3F});
        for (size_t k = 0; k < 3; ++k) {
            CHECK(result[3 * k] == doctest::Approx(0).epsilon(1e-6));
            CHECK(result[3 * k + 1] == doctest::Approx(0.25).epsilon(1e-6));
            CHECK(result[3 * k + 2] == doctest::Approx(1).epsilon(1e-6));
        }
    }

    TEST_CASE("one event is one step, at the event and not before") {
        const auto events = pack({{0, 0.5F, true}}, 1);
        const double step = std::exp(0.2);
        const double before = 0.51 / ((1.5 + 0.5 * step) / 2);
        const auto result = frames({0.5F}, events, {-1, 0.4999, 0.5, 1}, {0.2F, 0.9F});
        CHECK(result[0] == doctest::Approx(before - 0.01).epsilon(1e-5));
        CHECK(result[1] == result[0]);
        CHECK(result[2] == doctest::Approx(before * step - 0.01).epsilon(1e-5));
        CHECK(result[3] == result[2]);
    }

    TEST_CASE("each sign has its own threshold") {
        const auto up = pack({{0, 0.0F, true}}, 1);
        const auto down = pack({{0, 0.0F, false}}, 1);
        const auto ratio = [](const PackedEvents& events, const EdiThresholds& thresholds) {
            const auto result = frames({0.5F}, events, {-1, 1}, thresholds);
            return std::log((result[1] + 0.01) / (result[0] + 0.01));
        };
        CHECK(ratio(up, {0.15F, 0.3F}) == doctest::Approx(0.15).epsilon(1e-4));
        CHECK(ratio(up, {0.15F, 0.7F}) == doctest::Approx(0.15).epsilon(1e-4));
        CHECK(ratio(down, {0.15F, 0.3F}) == doctest::Approx(-0.3).epsilon(1e-4));
        CHECK(ratio(down, {0.8F, 0.3F}) == doctest::Approx(-0.3).epsilon(1e-4));
    }

    TEST_CASE("frames come in the order of the times asked for") {
        CaseRandom random(7);
        std::vector<Event> list;
        for (int i = 0; i < 40; ++i) {
            list.push_back(
                {random.integer(0, 4), static_cast<float>(i) / 20 - 1, random.integer(0, 1) == 1});
        }
        const auto events = pack(list, 5);
        const std::vector<float> blurry = {0.1F, 0.3F, 0.5F, 0.7F, 0.9F};
        const std::vector<double> times = {0.7, -1, 0.1, 0.1, 1, -0.4};
        const auto together = frames(blurry, events, times, {0.2F, 0.25F});
        for (size_t k = 0; k < times.size(); ++k) {
            const auto alone = frames(blurry, events, {times[k]}, {0.2F, 0.25F});
            CHECK(std::equal(alone.begin(), alone.end(),
                             together.begin() + static_cast<ptrdiff_t>(5 * k)));
        }
        CHECK_THROWS_AS(edi_schedule(std::vector<double>{1.5}), Error);
        CHECK_THROWS_AS(edi_schedule(std::vector<double>{NAN}), Error);
    }

    TEST_CASE("the mean over the exposure is the blurry frame") {
        // Events at multiples of 1/64: frames between them, equally spaced, have the exact mean.
        CaseRandom random(11);
        std::vector<Event> list;
        for (int i = -64; i <= 64; ++i) {
            for (uint32_t n = random.integer(0, 3); n > 0; --n) {
                list.push_back(
                    {random.integer(0, 3), static_cast<float>(i) / 64, random.integer(0, 2) == 0});
            }
        }
        std::vector<double> times;
        for (int i = 0; i < 128; ++i) {
            times.push_back((i + 0.5) / 64 - 1);
        }
        const std::vector<float> blurry = {0.05F, 0.3F, 0.6F, 1};
        const auto result = frames(blurry, pack(list, 4), times, {0.17F, 0.23F});
        for (size_t p = 0; p < 4; ++p) {
            double mean = 0;
            for (size_t k = 0; k < times.size(); ++k) {
                mean += double{result[4 * k + p]} / 128;
            }
            CHECK(mean == doctest::Approx(blurry[p]).epsilon(1e-5));
        }
    }

    TEST_CASE("a million events at one pixel stay finite and exact") {
        constexpr int count = 1'000'000;
        const auto check = [](auto&& positive, auto&& time) {
            std::vector<Event> list;
            for (int i = 0; i < count; ++i) {
                list.push_back({0, time(i), positive(i)});
            }
            const auto events = pack(std::move(list), 1);
            const std::vector<double> times = {-1, -0.5, 0, 0.7, 1};
            const EdiThresholds thresholds{0.35F, 0.3F};
            const std::vector<float> blurry = {0.5F};
            const auto result = frames(blurry, events, times, thresholds);
            const auto expected = reference::edi(blurry, events, times, thresholds);
            for (size_t k = 0; k < times.size(); ++k) {
                CHECK(std::isfinite(result[k]));
                CHECK(result[k] == doctest::Approx(expected[k]).epsilon(1e-3));
            }
        };
        const auto even = [](int i) { return static_cast<float>(2.0 * (i + 0.5) / count - 1); };
        check([](int) { return true; }, even);
        check([](int) { return false; }, even);
        check([](int i) { return i % 13 < 6; }, even);
        check([](int i) { return i < count / 2; }, [](int) { return 0.25F; });
        check([](int) { return true; }, [](int) { return 1.0F; });
    }

    TEST_CASE("estimation finds the thresholds of a scene") {
        const auto check = [](double travel, const EdiThresholds& truth, uint64_t seed) {
            const EdiThresholds found = estimate(simulate(96, 80, travel, truth, seed));
            INFO("travel ", travel, ", true ", truth.positive, " ", truth.negative, ", found ",
                 found.positive, " ", found.negative);
            CHECK(std::abs(std::log(found.positive / truth.positive)) < 0.2);
            CHECK(std::abs(std::log(found.negative / truth.negative)) < 0.2);
        };
        check(10, {0.15F, 0.15F}, 1);
        check(20, {0.12F, 0.144F}, 2);
        check(20, {0.34F, 0.29F}, 3);
        check(40, {0.25F, 0.22F}, 4);
        check(60, {0.18F, 0.2F}, 5);
    }

    TEST_CASE("estimation falls back where there is nothing to see") {
        const auto check = [](const std::vector<float>& blurry, const PackedEvents& events) {
            EdiThresholdEstimator estimator(device(), 32, 24);
            const EdiThresholds found = estimator.estimate(events, blurry).thresholds;
            CHECK(found.positive == doctest::Approx(0.2).epsilon(0.1));
            CHECK(found.negative == doctest::Approx(0.2).epsilon(0.1));
        };
        check(std::vector<float>(32 * 24, 0.4F), pack({}, 32 * 24));
        check(std::vector<float>(32 * 24, 0.4F),
              pack({{100, 0.1F, true}, {101, 0.2F, false}}, 32 * 24));
    }

    TEST_CASE("estimation repeats to the bit, also after other frames") {
        const Scene one = simulate(48, 40, 12, {0.2F, 0.2F}, 8);
        const Scene other = simulate(48, 40, 30, {0.15F, 0.15F}, 9);
        EdiThresholdEstimator estimator(device(), 48, 40);
        const EdiThresholds first = estimator.estimate(one.events, one.blurry).thresholds;
        estimator.estimate(other.events, other.blurry);
        CHECK(estimator.estimate(one.events, one.blurry).thresholds == first);
        CHECK_THROWS_AS(estimator.estimate(one.events, std::vector<float>(7)), Error);
        CHECK_THROWS_AS(EdiThresholdEstimator(device(), 15, 40), Error);
    }
}
