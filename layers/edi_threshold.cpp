#include "layers/edi_threshold.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "runtime/error.hpp"

namespace ecir {
namespace {

/// A point of the search: ln of the geometric mean of c+ and c-, and ln(c+ / c-).
struct Point {
    double size = 0;
    double ratio = 0;
};

const Point prior{std::log(0.2), 0};
constexpr Point prior_error{0.4, 0.12};

/// What motion fits leave undecided however many tiles there are: they come out some percent short.
constexpr double fit_error = 0.015;

/// The events' own noise makes thresholds slightly below the true ones give the smallest error.
constexpr double noise_shrinkage = 0.02;

EdiThresholds thresholds_at(const Point& point) {
    return {static_cast<float>(std::exp(point.size + point.ratio / 2)),
            static_cast<float>(std::exp(point.size - point.ratio / 2))};
}

/// Weight of a test: 1 / its variance, of which `least` squared stays whatever the data.
double weight(double error, double least) {
    const double variance = error * error + least * least;
    return variance > 0 ? 1 / variance : 0;
}

/// A point near which the falling test `blur` crosses zero, and how both tests slope along the
/// size.
struct Crossing {
    Point point = prior;
    EdiBalance value;
    double blur_slope = 0;
    double drift_slope = 0;
};

/// Walks from the prior over a grid of sizes until `blur` changes its sign; stays at the prior when
/// it does not.
Crossing find_crossing(const std::function<EdiBalance(const EdiThresholds&)>& balance) {
    constexpr double spacing = 0.3;
    constexpr int most = 3; // 0.08 to 0.49
    const EdiBalance middle = balance(thresholds_at(prior));
    const double direction = middle.blur > 0 ? spacing : -spacing;
    const auto slope = [&](double near, double far) { return (far - near) / direction; };
    Crossing result{prior, middle, 0, 0};
    EdiBalance near = middle;
    for (int i = 1; i <= most; ++i) {
        const Point point{prior.size + i * direction, prior.ratio};
        const EdiBalance far = balance(thresholds_at(point));
        const bool crossed = (far.blur > 0) != (middle.blur > 0);
        if (i == 1 || crossed) {
            result.blur_slope = std::min(slope(near.blur, far.blur), -1e-3);
            result.drift_slope = slope(near.drift, far.drift);
        }
        if (crossed) {
            const bool closer = std::abs(far.blur) < std::abs(near.blur);
            result.point.size = point.size - (closer ? 0 : direction);
            result.value = closer ? far : near;
            break;
        }
        near = far;
    }
    return result;
}

} // namespace

EdiBalance edi_balance(std::span<const float> moments, uint32_t tiles) {
    using Sums = std::array<double, edi_moment_count>;
    const size_t plane = size_t{edi_windows} * tiles;
    std::vector<Sums> of_tiles(tiles);
    Sums sum{};
    for (size_t tile = 0; tile < tiles; ++tile) {
        for (size_t m = 0; m < edi_moment_count; ++m) {
            for (size_t window = 0; window < edi_windows; ++window) {
                of_tiles[tile][m] += double{moments[m * plane + window * tiles + tile]};
            }
            sum[m] += of_tiles[tile][m];
        }
    }
    // A weighted sum of some moments over all tiles, and its standard error.
    const auto tell = [&](double weight, size_t m, double other_weight, size_t other) {
        double squares = 0;
        for (const Sums& tile : of_tiles) {
            squares += std::pow(weight * tile[m] + other_weight * tile[other], 2);
        }
        return std::array{weight * sum[m] + other_weight * sum[other], std::sqrt(squares)};
    };
    constexpr std::array unknown = {0.0, std::numeric_limits<double>::infinity()};
    const auto [blur, blur_error] = sum[1] > 0 ? tell(1 / sum[1], 0, 0, 0) : unknown;
    const auto [drift, drift_error] = sum[3] > 0 ? tell(1 / sum[3], 2, 0, 2) : unknown;
    // S spans the time from the first window's middle to the last one's.
    constexpr double share = 1.0 * (edi_windows - 1) / edi_windows;
    const double determinant = sum[1] * sum[5] - sum[6] * sum[6];
    const auto [lag, lag_error] =
        determinant > 1e-6 * sum[1] * sum[5]
            ? tell(share * sum[1] / determinant, 4, -share * sum[6] / determinant, 0)
            : unknown;
    return {blur, drift, blur_error, drift_error, lag, lag_error};
}

EdiEstimate solve_edi_thresholds(const std::function<EdiBalance(const EdiThresholds&)>& balance) {
    constexpr double longest_step = 0.3;
    constexpr double close_enough = 0.04; // what is left after such a step is of second order
    constexpr int most_steps = 4;
    constexpr double drift_by_ratio = 0.5; // mostly 0.3 to 0.7
    const Crossing crossing = find_crossing(balance);
    Point point = crossing.point;
    EdiBalance here = crossing.value;
    // Derivatives of the tests by size and ratio.
    std::array<double, 2> blur = {crossing.blur_slope, 0};
    std::array<double, 2> drift = {crossing.drift_slope, drift_by_ratio};

    for (int step = 0;; ++step) {
        // Gauss-Newton on the squared tests and the squared distance from the prior.
        const double wb = weight(here.blur_error, fit_error);
        const double wd = weight(here.drift_error, 1e-9);
        const double wp = weight(prior_error.size, 0);
        const double wr = weight(prior_error.ratio, 0);
        const double ss = wb * blur[0] * blur[0] + wd * drift[0] * drift[0] + wp;
        const double sr = wb * blur[0] * blur[1] + wd * drift[0] * drift[1];
        const double rr = wb * blur[1] * blur[1] + wd * drift[1] * drift[1] + wr;
        const double s =
            wb * blur[0] * here.blur + wd * drift[0] * here.drift + wp * (point.size - prior.size);
        const double r = wb * blur[1] * here.blur + wd * drift[1] * here.drift +
                         wr * (point.ratio - prior.ratio);
        const double determinant = ss * rr - sr * sr;
        const Point next{std::clamp(point.size + std::clamp((sr * r - rr * s) / determinant,
                                                            -longest_step, longest_step),
                                    std::log(0.06), std::log(0.6)),
                         std::clamp(point.ratio + std::clamp((sr * s - ss * r) / determinant,
                                                             -longest_step, longest_step),
                                    -0.5, 0.5)};
        const double ds = next.size - point.size;
        const double dr = next.ratio - point.ratio;
        if (step == most_steps || std::max(std::abs(ds), std::abs(dr)) < close_enough) {
            return {thresholds_at({next.size - noise_shrinkage, next.ratio}),
                    std::sqrt(rr / determinant), std::sqrt(ss / determinant)};
        }
        const EdiBalance there = balance(thresholds_at(next));
        // Broyden's update; the slope that the walk found is kept in part, so that noise cannot
        // turn it, nor that of the drift.
        const double length = ds * ds + dr * dr;
        const double blur_miss = there.blur - here.blur - blur[0] * ds - blur[1] * dr;
        const double drift_miss = there.drift - here.drift - drift[0] * ds - drift[1] * dr;
        blur = {std::min(blur[0] + blur_miss * ds / length, 0.3 * crossing.blur_slope),
                blur[1] + blur_miss * dr / length};
        drift = {drift[0] + drift_miss * ds / length,
                 std::max(drift[1] + drift_miss * dr / length, 0.3 * drift_by_ratio)};
        point = next;
        here = there;
    }
}

EdiThresholdEstimator::EdiThresholdEstimator(Device& device, uint32_t width, uint32_t height)
    : device_(device), width_(width), height_(height), shape_(edi_moment_shape(width, height)) {}

void EdiThresholdEstimator::record(uint32_t capacity) {
    field_maker_.reset(); // what they hold must be free before the next ones ask for as much
    tester_.reset();
    const auto make_input = [&](Program& program) {
        EdiInput input;
        input.offsets = program.input({1, 1, width_ * height_ + 1});
        input.times = program.input({1, 1, capacity});
        input.marks = program.input({1, 1, capacity});
        input.blurry = program.input({1, height_, width_});
        input.thresholds = program.input({1, 1, 2});
        return input;
    };
    auto maker = std::make_unique<Program>(device_);
    frame_ = make_input(*maker);
    fields_ = maker->output(shape_.fields());
    record_edi_fields(*maker, frame_, fields_);
    maker->finish();

    auto tester = std::make_unique<Program>(device_);
    tested_ = make_input(*tester);
    tested_fields_ = tester->input(shape_.fields());
    moments_ = tester->output(shape_.moments());
    record_edi_moments(*tester, tested_, tested_fields_, moments_);
    tester->finish();

    field_maker_ = std::move(maker); // none is left behind unfinished
    tester_ = std::move(tester);
    capacity_ = capacity;
}

void EdiThresholdEstimator::prepare(const PackedEvents& events, std::span<const float> blurry) {
    const size_t pixels = size_t{width_} * height_;
    if (blurry.size() != pixels || events.offset.size() != pixels + 1) {
        throw Error(ExitCode::bad_input, "threshold estimation for " + std::to_string(width_) +
                                             "x" + std::to_string(height_) +
                                             " pixels got an image of " +
                                             std::to_string(blurry.size()) + " and events of " +
                                             std::to_string(events.offset.size() - 1) + " pixels");
    }
    const auto count = static_cast<uint32_t>(events.size());
    if (!tester_ || count > capacity_) {
        // Room for half as many more, so that a recording seldom needs new programs.
        record(std::max(1024U, count + count / 2));
    }
    const auto write = [&](Program& program, const EdiInput& input) {
        program.write(input.offsets, events.offset);
        program.write(input.times, events.time);
        program.write(input.marks, events.mark);
        program.write(input.blurry, blurry);
    };
    write(*field_maker_, frame_);
    field_maker_->run();
    write(*tester_, tested_);
    tester_->write(tested_fields_, field_maker_->read(fields_));
}

EdiBalance EdiThresholdEstimator::run(const EdiThresholds& thresholds) {
    const std::array<float, 2> values = {thresholds.positive, thresholds.negative};
    tester_->write(tested_.thresholds, std::span<const float>(values));
    tester_->run();
    return edi_balance(tester_->read(moments_), shape_.tiles());
}

EdiEstimate EdiThresholdEstimator::estimate(const PackedEvents& events,
                                            std::span<const float> blurry) {
    prepare(events, blurry);
    return solve_edi_thresholds([&](const EdiThresholds& thresholds) { return run(thresholds); });
}

EdiBalance EdiThresholdEstimator::balance(const PackedEvents& events, std::span<const float> blurry,
                                          const EdiThresholds& thresholds) {
    prepare(events, blurry);
    return run(thresholds);
}

EdiThresholdSource::EdiThresholdSource(Device& device, uint32_t width, uint32_t height,
                                       std::optional<EdiThresholds> given)
    : width_(width), height_(height), given_(given) {
    if (!given_ && std::min(width, height) < edi_smallest_side) {
        given_ = EdiThresholds{};
    }
    if (!given_) {
        estimator_ = std::make_unique<EdiThresholdEstimator>(device, width, height);
    }
}

EdiThresholds EdiThresholdSource::choose(const EventView& events, const Exposure& exposure,
                                         std::span<const float> blurry) {
    if (given_) {
        return *given_;
    }
    return track_.next([&] {
        return estimator_->estimate(pack_events(events, exposure, width_, height_), blurry);
    });
}

} // namespace ecir
