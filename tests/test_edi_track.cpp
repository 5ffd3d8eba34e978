#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "layers/edi_track.hpp"

using namespace ecir;

namespace {

/// Feeds one estimate a frame, and says what each frame got and which were estimated.
struct Recording {
    EdiThresholdTrack track;
    size_t estimations = 0;

    EdiThresholds next(const EdiEstimate& estimate) {
        return track.next([&] {
            ++estimations;
            return estimate;
        });
    }
};

EdiEstimate told(float threshold, double error = 0.03) {
    return {{threshold, threshold}, error, error};
}

constexpr double vague = 0.3; // an error beyond what tells

} // namespace

TEST_SUITE("edi_track") {
    TEST_CASE("the track gives the first frame its own estimate") {
        for (const double error : {0.03, vague}) {
            Recording recording;
            const EdiEstimate first{{0.31F, 0.28F}, error, error};
            CHECK(recording.next(first) == first.thresholds);
        }
    }

    TEST_CASE("the track settles on the median and rests") {
        Recording recording;
        const std::vector<float> estimates = {0.2F,   0.21F,  0.19F, 0.5F, 0.2F,
                                              0.205F, 0.195F, 0.1F,  0.2F};
        EdiThresholds last;
        for (const float estimate : estimates) {
            last = recording.next(told(estimate));
        }
        CHECK(recording.estimations == 9);
        CHECK(last.positive == doctest::Approx(0.2).epsilon(1e-5));
        CHECK(last.negative == doctest::Approx(0.2).epsilon(1e-5));
        for (int frame = 0; frame < 31; ++frame) {
            CHECK(recording.next(told(0.7F)) == last);
        }
        CHECK(recording.estimations == 9);
        recording.next(told(0.2F));
        CHECK(recording.estimations == 10);
    }

    TEST_CASE("the track takes a precise estimate for more than a rough one") {
        Recording recording;
        recording.next(told(0.2F, 0.02));
        const EdiThresholds both = recording.next(told(0.3F, 0.14));
        CHECK(both.positive > 0.2F);
        CHECK(both.positive < 0.25F);
    }

    TEST_CASE("frames that tell nothing neither set the track nor let it rest") {
        Recording recording;
        for (int frame = 0; frame < 40; ++frame) {
            CHECK(recording.next(told(0.25F, vague)) == told(0.25F).thresholds);
        }
        CHECK(recording.estimations == 40);
        CHECK(recording.next(told(0.14F)) == told(0.14F).thresholds);
        CHECK(recording.next(told(0.25F, vague)) == told(0.14F).thresholds);
    }

    TEST_CASE("the track follows a change of the sensor, and no single outlier") {
        Recording recording;
        EdiThresholds value;
        for (int frame = 0; frame < 9 + 31; ++frame) {
            recording.next(told(0.2F));
        }
        value = recording.next(told(0.4F)); // one outlier where it looks again
        CHECK(value.positive == doctest::Approx(0.2).epsilon(1e-5));
        recording.next(told(0.2F));
        CHECK(recording.estimations == 11);
        for (int frame = 0; frame < 31; ++frame) {
            recording.next(told(0.4F));
        }
        CHECK(recording.estimations == 11);
        for (int frame = 0; frame < 9; ++frame) {
            value = recording.next(told(0.4F));
        }
        CHECK(value.positive == doctest::Approx(0.4).epsilon(1e-5));
        CHECK(recording.estimations < 20);
    }
}
