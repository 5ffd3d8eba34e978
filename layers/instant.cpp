#include "layers/instant.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>

#include "runtime/error.hpp"

namespace ecir {

Instant::Instant(double normalised) : time(static_cast<float>(normalised)) {
    if (!(normalised >= -1 && normalised <= 1)) {
        throw Error(ExitCode::bad_input, "frame time " + std::to_string(normalised) +
                                             " lies outside the exposure, -1 to 1");
    }
    place = (time + 1) * ((anchor_count - 1) / 2.0F);
    below = std::min(static_cast<uint32_t>(place), anchor_count - 2);
    const auto distance = [this](uint32_t anchor) {
        return std::abs(place - static_cast<float>(anchor));
    };
    for (uint32_t a = 0; a < anchor_count; ++a) {
        for (uint32_t b = 0; b < anchor_count; ++b) {
            const bool nearer = distance(b) < distance(a) || (distance(b) == distance(a) && b < a);
            rank.at(a) += nearer ? 1 : 0;
        }
    }
}

std::vector<Instant> make_instants(std::span<const double> times) {
    std::vector<Instant> instants(times.begin(), times.end());
    std::vector<size_t> order(times.size());
    std::iota(order.begin(), order.end(), size_t{0});
    std::ranges::stable_sort(order, {}, [&](size_t i) { return times[i]; });
    double reach = 0; // furthest from a time
    double begin = -1;
    for (size_t k = 0; k < order.size(); ++k) {
        const double time = times[order[k]];
        const bool last = k + 1 == order.size();
        const double end = last ? 1 : (time + times[order[k + 1]]) / 2;
        instants[order[k]].share = static_cast<float>((end - begin) / 2);
        reach = std::max({reach, time - begin, end - time});
        begin = end;
    }
    if (constexpr double rounding = 1e-6; reach > exposure_reach + rounding) {
        for (Instant& instant : instants) {
            instant.share = 0;
        }
    }
    return instants;
}

} // namespace ecir
