#include "layers/scene_facts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <numeric>

#include "layers/travel.hpp"

namespace ecir {
namespace {

constexpr float kWhite = 0.98F;
constexpr float kBlack = 0.02F;

/// Largest and sum of the counts of the eight neighbours.
struct Around {
    uint32_t most = 0;
    uint64_t sum = 0;
};

Around around(const std::vector<uint32_t>& counts, uint32_t width, uint32_t height, uint32_t x,
              uint32_t y) {
    Around result;
    for (uint32_t row = y > 0 ? y - 1 : 0; row <= std::min(y + 1, height - 1); ++row) {
        for (uint32_t column = x > 0 ? x - 1 : 0; column <= std::min(x + 1, width - 1); ++column) {
            if (row != y || column != x) {
                const uint32_t count = counts[size_t{row} * width + column];
                result.most = std::max(result.most, count);
                result.sum += count;
            }
        }
    }
    return result;
}

void judge_pixels(const std::vector<uint32_t>& counts, uint32_t width, uint32_t height,
                  SceneFacts& facts) {
    constexpr uint32_t kHot = 20; // events: what a fast edge's texture rarely reaches alone
    size_t active = 0;
    uint64_t isolated = 0;
    for (uint32_t y = 0; y < height; ++y) {
        for (uint32_t x = 0; x < width; ++x) {
            const uint32_t count = counts[size_t{y} * width + x];
            if (count == 0) {
                continue;
            }
            ++active;
            const Around near = around(counts, width, height, x, y);
            isolated += near.sum == 0 ? count : 0;
            facts.hot_pixels += count >= kHot && uint64_t{near.most} * 5 < count ? 1 : 0;
        }
    }
    facts.active_share = static_cast<double>(active) / static_cast<double>(counts.size());
    facts.isolated_share =
        facts.events > 0 ? static_cast<double>(isolated) / static_cast<double>(facts.events) : 0;
}

double agreeing_share(const EventView& events, uint32_t width, uint32_t height) {
    constexpr size_t kMost = 131'072;
    constexpr size_t kFewest = 1000;
    struct Latest {
        uint32_t place = 0; ///< among the events, from 1; 0: none
        uint8_t sign = 0;
    };
    const size_t row = size_t{width} + 2; // with a border that has no events
    std::vector<Latest> latest(row * (size_t{height} + 2));
    size_t met = 0;
    size_t agreeing = 0;
    for (size_t i = 0; i < std::min(events.size(), kMost); ++i) {
        const size_t at = (size_t{events.y[i]} + 1) * row + events.x[i] + 1;
        Latest near;
        for (const size_t line : {at - row, at, at + row}) {
            for (const size_t place : {line - 1, line, line + 1}) {
                if (place != at && latest[place].place > near.place) {
                    near = latest[place];
                }
            }
        }
        met += near.place != 0 ? 1 : 0;
        agreeing += near.place != 0 && near.sign == events.p[i] ? 1 : 0;
        latest[at] = {static_cast<uint32_t>(i + 1), events.p[i]};
    }
    return met < kFewest ? 1 : static_cast<double>(agreeing) / static_cast<double>(met);
}

/// Share of the variance of the signed event rate that a sine explains, trend aside.
void find_flicker(const EventView& events, const Exposure& exposure, SceneFacts& facts) {
    constexpr int64_t kBin = 1000; // microseconds
    constexpr double kPeriods = 3;
    const auto bins = static_cast<size_t>(exposure.duration() / kBin);
    const double seconds = static_cast<double>(bins) * 1e-3;
    if (seconds * 100 < kPeriods || bins > 100'000) {
        return;
    }
    std::vector<double> rate(bins);
    for (size_t i = 0; i < events.size(); ++i) {
        const auto bin = static_cast<size_t>((events.t[i] - exposure.start) / kBin);
        if (bin < bins) {
            rate[bin] += events.p[i] != 0 ? 1 : -1;
        }
    }
    const auto n = static_cast<double>(bins);
    double mean = 0;
    double slope = 0;
    double spread = 0;
    for (size_t k = 0; k < bins; ++k) {
        const double place = static_cast<double>(k) - (n - 1) / 2;
        mean += rate[k] / n;
        slope += place * rate[k];
        spread += place * place;
    }
    slope /= spread;
    double variance = 0;
    for (size_t k = 0; k < bins; ++k) {
        rate[k] -= mean + slope * (static_cast<double>(k) - (n - 1) / 2);
        variance += rate[k] * rate[k];
    }
    for (const double hertz : {100.0, 120.0}) {
        double c = 0;
        double s = 0;
        for (size_t k = 0; k < bins; ++k) {
            const double phase = 2 * std::numbers::pi * hertz * 1e-3 * static_cast<double>(k);
            c += rate[k] * std::cos(phase);
            s += rate[k] * std::sin(phase);
        }
        const double share = variance > 0 ? 2 * (c * c + s * s) / (n * variance) : 0;
        if (facts.flicker_hz == 0 || share > facts.flicker_share) {
            facts.flicker_hz = hertz;
            facts.flicker_share = std::min(share, 1.0);
        }
    }
}

/// A gap counts when stretches of its length before and after it have so many events each that
/// chance does not leave one out.
int64_t longest_gap(const EventView& events) {
    constexpr ptrdiff_t kBusy = 200;
    constexpr int64_t kShortest = 1000; // microseconds; simulated events come in steps of time
    int64_t longest = kShortest - 1;
    for (size_t i = 1; i < events.size(); ++i) {
        const int64_t gap = events.t[i] - events.t[i - 1];
        if (gap <= longest) {
            continue;
        }
        const auto here = events.t.begin() + static_cast<ptrdiff_t>(i);
        const auto before = std::lower_bound(events.t.begin(), here, events.t[i - 1] - gap);
        const auto after = std::upper_bound(here, events.t.end(), events.t[i] + gap);
        if (here - before >= kBusy && after - here >= kBusy) {
            longest = gap;
        }
    }
    return longest >= kShortest ? longest : 0;
}

std::string text(const char* format, double a, double b = 0) {
    std::array<char, 320> buffer{};
    std::snprintf(buffer.data(), buffer.size(), format, a, b);
    return buffer.data();
}

} // namespace

double bunched_share(const EventView& events, const Exposure& exposure) {
    constexpr size_t kFewest = 200;
    constexpr int64_t kShortest = 1000; // microseconds
    if (events.size() < kFewest || exposure.duration() < kShortest) {
        return 0;
    }
    std::array<size_t, 5> most{}; // ascending
    for (size_t i = 0; i < events.size();) {
        size_t end = i;
        while (end < events.size() && events.t[end] == events.t[i]) {
            ++end;
        }
        if (end - i > most.front()) {
            most.front() = end - i;
            std::ranges::sort(most);
        }
        i = end;
    }
    return static_cast<double>(std::accumulate(most.begin(), most.end(), size_t{0})) /
           static_cast<double>(events.size());
}

SceneFacts scene_facts(std::span<const float> blurry, const EventView& events,
                       const Exposure& exposure, uint32_t width, uint32_t height) {
    SceneFacts facts;
    const auto pixels = static_cast<double>(blurry.size());
    facts.white_share =
        static_cast<double>(std::ranges::count_if(blurry, [](float b) { return b >= kWhite; })) /
        pixels;
    facts.black_share =
        static_cast<double>(std::ranges::count_if(blurry, [](float b) { return b < kBlack; })) /
        pixels;
    facts.events = events.size();
    if (facts.events == 0) {
        return facts;
    }
    facts.events_per_pixel = static_cast<double>(facts.events) / pixels;
    facts.positive_share =
        static_cast<double>(std::ranges::count_if(events.p, [](uint8_t p) { return p != 0; })) /
        static_cast<double>(facts.events);
    judge_pixels(event_counts(events, width, height), width, height, facts);
    facts.agreeing_share = agreeing_share(events, width, height);
    facts.travel = estimate_travel(blurry, events, exposure, width, height);
    find_flicker(events, exposure, facts);
    facts.bunched_share = bunched_share(events, exposure);
    facts.longest_gap = longest_gap(events);
    return facts;
}

std::vector<SceneWarning> scene_warnings(const SceneFacts& facts, const TravelRange& served) {
    constexpr double kManyWhite = 0.02;
    constexpr double kManyBlack = 0.9;
    constexpr double kOneSign = 0.85;
    constexpr double kFlicker = 0.3;
    constexpr double kIsolated = 0.3;
    constexpr double kNoisy = 0.002; // such events a pixel
    constexpr double kAgreeing = 0.6;
    constexpr double kBunched = 0.1; // costs up to 1.1 dB; what sensors and simulations give: 0.015
    constexpr double kHotShare = 1e-3; // of the pixels
    std::vector<SceneWarning> found;
    const auto warn = [&](const char* name, const std::string& what) {
        found.push_back({name, what});
    };
    if (facts.events == 0) {
        warn("no-events", "no event in the exposure: every frame is the blurry one");
        return found;
    }
    if (facts.white_share > kManyWhite) {
        warn("saturated",
             text("%.0f %% of the blurry frame is white: what moved there is lost, and "
                  "its edges keep some blur; expose for less time",
                  100 * facts.white_share));
    }
    if (facts.black_share > kManyBlack) {
        warn("dark", text("%.0f %% of the blurry frame is black: there is little to sharpen",
                          100 * facts.black_share));
    }
    if (std::abs(facts.positive_share - 0.5) > kOneSign - 0.5) {
        warn("one-sign",
             text("%.0f %% of the events are of one sign: light that changes during the "
                  "exposure, or a sensor that reports one sign only; frames drift in "
                  "brightness",
                  100 * std::max(facts.positive_share, 1 - facts.positive_share)));
    }
    if (facts.flicker_share > kFlicker) {
        warn("flicker",
             text("%.0f %% of how the event rate varies is a sine of %.0f Hz: the lamps flicker, "
                  "and frames between two half-waves differ in brightness",
                  100 * facts.flicker_share, facts.flicker_hz));
    }
    if (facts.isolated_share > kIsolated &&
        facts.isolated_share * facts.events_per_pixel > kNoisy) {
        warn("noise", text("%.0f %% of the events have no neighbour: background noise, which "
                           "frames keep in part",
                           100 * facts.isolated_share));
    } else if (facts.agreeing_share < kAgreeing && facts.bunched_share <= kBunched) {
        warn("noise", text("only %.0f %% of the events have the sign of their latest neighbour, as "
                           "many as by chance: noise, which frames of a network show in part and "
                           "others in full",
                           100 * facts.agreeing_share));
    }
    if (static_cast<double>(facts.hot_pixels) * facts.events_per_pixel >
        kHotShare * static_cast<double>(facts.events)) {
        warn("hot-pixels", text("%.0f hot pixels: mask them in the sensor",
                                static_cast<double>(facts.hot_pixels)));
    }
    if (facts.bunched_share > kBunched) {
        warn("bunched",
             text("%.0f %% of the events lie at five of the exposure's microseconds: a clock that "
                  "is too coarse, or a bus that delayed them; edges keep some blur; have the "
                  "sensor's driver stamp each event",
                  100 * facts.bunched_share));
    } else if (facts.longest_gap > 0) {
        warn("gap", text("no event for %.1f ms between busy stretches: the sensor's bus dropped "
                         "events, and frames there keep some blur",
                         static_cast<double>(facts.longest_gap) * 1e-3));
    }
    if (facts.travel < served.least) {
        warn("slow", text("motion of about %.1f pixels during the exposure, too little for this "
                          "model: the blurry frame is nearer to the truth; use another one",
                          facts.travel));
    }
    if (facts.travel > served.most) {
        warn("fast", text("motion of about %.0f pixels during the exposure, more than the network "
                          "was trained on; -m edi has no such limit",
                          facts.travel));
    }
    return found;
}

std::optional<SceneWarning> lag_warning(const SceneFacts& facts, const Exposure& exposure,
                                        double late_us) {
    constexpr double kFar = 1.5; // pixels; estimates are mostly within one
    const double pixels =
        facts.travel * std::abs(late_us) / static_cast<double>(exposure.duration());
    if (pixels < kFar) {
        return std::nullopt;
    }
    return SceneWarning{"late",
                        text("the events are about %.1f ms ", std::abs(late_us) * 1e-3) +
                            (late_us > 0 ? "later" : "earlier") +
                            text(" against the frame than assumed, %.0f pixels of motion: frames "
                                 "are displaced and keep ghosts of the ends; try --lag auto",
                                 pixels)};
}

} // namespace ecir
