#include <algorithm>
#include <cmath>
#include <limits>

#include "tools/stability/run.hpp"

namespace ecir::stability {
namespace {

namespace svg = cli::svg;
using svg::Scale;
using svg::Spread;

constexpr double kWidth = 900;
constexpr double kHeight = 480;
constexpr svg::Box kBox{80, 90, 640, 420};
constexpr double kLegend = 665;

Scale x_scale(const Result& result) {
    const Sweep& sweep = result.sweep;
    const auto [low, high] = std::ranges::minmax(result.values);
    if (sweep.x.spread == Spread::listed || !sweep.labels.empty() || low == high) {
        Scale scale{.spread = Spread::listed, .places = result.values};
        for (size_t i = 0; i < result.values.size(); ++i) {
            scale.names.push_back(result.label(i));
        }
        return scale;
    }
    if (sweep.x.spread == Spread::logarithmic) {
        const double margin = std::pow(high / low, 0.03);
        return {.low = low / margin, .high = high * margin, .spread = Spread::logarithmic};
    }
    const double margin = 0.03 * (high - low);
    return {.low = low - margin, .high = high + margin};
}

Scale y_scale(const Result& result) {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    const bool logarithmic = result.sweep.y.spread == Spread::logarithmic;
    const auto include = [&](double value) {
        if (std::isfinite(value) && (!logarithmic || value > 0)) {
            low = std::min(low, value);
            high = std::max(high, value);
        }
    };
    for (const auto& samples : result.samples) {
        for (const Sample& sample : samples) {
            include(sample.value);
        }
    }
    if (result.sweep.limit) {
        include(*result.sweep.limit);
    }
    if (!(low <= high)) {
        low = high = 1; // nothing to draw
    }
    if (logarithmic) {
        const double margin = std::max(1.5, std::pow(high / low, 0.05));
        return {.low = low / margin, .high = high * margin, .spread = Spread::logarithmic};
    }
    const double margin = high > low ? 0.08 * (high - low) : 1;
    return {.low = low - margin, .high = high + margin};
}

std::string cross(double x, double y, const std::string& colour) {
    const std::string style = "stroke='" + colour + "' stroke-width='2.5'";
    return svg::line(x - 5, y - 5, x + 5, y + 5, style) +
           svg::line(x - 5, y + 5, x + 5, y - 5, style);
}

/// What a series' line and marks look like.
struct Look {
    std::string colour;
    bool reference;
    [[nodiscard]] std::string stroke() const {
        return "stroke='" + colour + "' stroke-width='" + (reference ? "1.5" : "2") + "'" +
               (reference ? " stroke-dasharray='6 4'" : "");
    }
};

std::string draw_series(const Result& result, const std::string& name, const svg::Axes& axes,
                        const Look& look) {
    std::string points;
    std::string marks;
    std::string lines;
    const auto end_line = [&] {
        // Kinds have no between.
        if (!points.empty() && result.sweep.labels.empty()) {
            lines += svg::polyline(points, look.stroke());
        }
        points.clear();
    };
    for (size_t i = 0; i < result.values.size(); ++i) {
        const Sample* sample = result.find(i, name);
        if (sample == nullptr) {
            continue;
        }
        const double x = axes.x(result.values[i]);
        const bool logarithmic = result.sweep.y.spread == Spread::logarithmic;
        if (!std::isfinite(sample->value)) { // refused, or no number: at the upper edge
            marks += cross(x, axes.box().top, look.colour);
            end_line();
            continue;
        }
        // What is exactly 0 has no place on a logarithmic axis: at its lower edge.
        const double y =
            logarithmic && sample->value <= 0 ? axes.box().bottom : axes.y(sample->value);
        points += svg::number(x) + "," + svg::number(y) + " ";
        if (sample->failed) {
            marks += cross(x, y, look.colour);
        } else if (!look.reference) {
            marks += "<circle cx='" + svg::number(x) + "' cy='" + svg::number(y) +
                     "' r='3.5' fill='" + look.colour + "'/>\n";
        }
    }
    end_line();
    return lines + marks;
}

std::string legend(const std::string& text, double y, const Look& look) {
    return svg::line(kLegend, y, kLegend + 24, y, look.stroke()) +
           (look.reference ? ""
                           : "<circle cx='" + svg::number(kLegend + 12) + "' cy='" +
                                 svg::number(y) + "' r='3.5' fill='" + look.colour + "'/>\n") +
           svg::text_at(kLegend + 32, y + 4, text, "");
}

} // namespace

std::string line_chart(const Result& result, const std::string& where) {
    const svg::Axes axes(kBox, x_scale(result), y_scale(result));
    std::string text = axes.draw(result.sweep.x.label, result.sweep.y.label);
    double y = kBox.top + 8;
    size_t methods = 0;
    size_t references = 0;
    if (result.sweep.limit) {
        const double at = axes.y(*result.sweep.limit);
        const Look look{"#b00020", true};
        text += svg::line(kBox.left, at, kBox.right, at, look.stroke());
        text += legend("fails above", y, look);
        y += 22;
    }
    for (const std::string& name : result.series()) {
        const Sample* first = nullptr;
        for (size_t i = 0; i < result.values.size() && first == nullptr; ++i) {
            first = result.find(i, name);
        }
        const bool reference = first->reference;
        constexpr const char* greys[] = {"#111", "#888", "#bbb"};
        const bool bound = name.starts_with("fails");
        const Look look{bound       ? "#b00020"
                        : reference ? greys[references++ % 3]
                                    : svg::colours.at(methods++ % svg::colours.size()),
                        reference};
        text += draw_series(result, name, axes, look);
        text += legend(name, y, look);
        y += 22;
    }
    text += cross(kLegend + 12, y, "#555") +
            svg::text_at(kLegend + 32, y + 4, "fails there", "fill='#555'");
    return svg::document(kWidth, kHeight + (result.sweep.labels.empty() ? 0 : 80),
                         result.sweep.title, where, text);
}

} // namespace ecir::stability
