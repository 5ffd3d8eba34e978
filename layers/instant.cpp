#include "layers/instant.hpp"

#include <algorithm>
#include <cmath>
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
    return {times.begin(), times.end()};
}

} // namespace ecir
