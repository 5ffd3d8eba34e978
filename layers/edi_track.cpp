#include "layers/edi_track.hpp"

#include <algorithm>
#include <cmath>

namespace ecir {
namespace {

constexpr size_t enough = 9;
constexpr size_t period = 32;
constexpr double telling_error = 0.15;
constexpr double disagreement = 0.2;

/// By how much estimates of frames of one recording differ beyond their errors.
constexpr double frame_spread = 0.05;

double size_of(const EdiThresholds& thresholds) {
    return 0.5 * std::log(double{thresholds.positive} * double{thresholds.negative});
}

double ratio_of(const EdiThresholds& thresholds) {
    return std::log(double{thresholds.positive} / double{thresholds.negative});
}

struct Weighted {
    double value = 0;
    double weight = 0;
};

/// Each value stands at the middle of its share of the weights in ascending order; the median is
/// what lies at half of all, between two values in proportion.
double weighted_median(std::vector<Weighted> values) {
    std::ranges::sort(values, {}, &Weighted::value);
    double half = 0;
    for (const Weighted& each : values) {
        half += each.weight / 2;
    }
    double place = values.front().weight / 2;
    for (size_t i = 1; i < values.size(); ++i) {
        const Weighted& low = values[i - 1];
        const Weighted& high = values[i];
        const double next = place + (low.weight + high.weight) / 2;
        if (next >= half) {
            return place >= half
                       ? low.value
                       : low.value + (high.value - low.value) * (half - place) / (next - place);
        }
        place = next;
    }
    return values.back().value;
}

} // namespace

EdiThresholds EdiThresholdTrack::median() const {
    if (told_.size() == 1) {
        return told_.front().thresholds; // to the bit
    }
    std::vector<Weighted> sizes;
    std::vector<Weighted> ratios;
    const auto weight = [](double error) {
        return 1 / (error * error + frame_spread * frame_spread);
    };
    for (const EdiEstimate& each : told_) {
        sizes.push_back({size_of(each.thresholds), weight(each.size_error)});
        ratios.push_back({ratio_of(each.thresholds), weight(each.ratio_error)});
    }
    const double size = weighted_median(std::move(sizes));
    const double ratio = weighted_median(std::move(ratios));
    return {static_cast<float>(std::exp(size + ratio / 2)),
            static_cast<float>(std::exp(size - ratio / 2))};
}

EdiThresholds EdiThresholdTrack::next(const std::function<EdiEstimate()>& estimate) {
    if (rest_ > 0) {
        --rest_;
        return median();
    }
    const EdiEstimate found = estimate();
    if (found.size_error > telling_error) {
        return told_.empty() ? found.thresholds : median();
    }
    told_.push_back(found);
    if (told_.size() > enough) {
        told_.erase(told_.begin());
    }
    const EdiThresholds value = median();
    const bool agrees = std::abs(size_of(found.thresholds) - size_of(value)) < disagreement &&
                        std::abs(ratio_of(found.thresholds) - ratio_of(value)) < disagreement;
    if (told_.size() == enough && agrees) {
        rest_ = period - 1;
    }
    return value;
}

} // namespace ecir
