#include "tools/ecir/svg.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace ecir::cli::svg {
namespace {

std::string escape(const std::string& text) {
    std::string result;
    for (const char c : text) {
        result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : std::string(1, c);
    }
    return result;
}

std::string tick_text(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value);
    return text;
}

/// At steps of 1, 2 or 5 times a power of ten, about `count` of them in [low, high].
std::vector<double> even_ticks(double low, double high, int count) {
    const double rough = (high - low) / count;
    const double power = std::pow(10, std::floor(std::log10(rough)));
    double step = 10 * power;
    for (const double factor : {1.0, 2.0, 5.0}) {
        if (factor * power >= rough) {
            step = factor * power;
            break;
        }
    }
    std::vector<double> ticks;
    for (auto i = static_cast<long>(std::ceil(low / step)); static_cast<double>(i) * step <= high;
         ++i) {
        ticks.push_back(static_cast<double>(i) * step);
    }
    return ticks;
}

/// 1, 2 and 5 times the powers of ten in [low, high]; over many decades every so many powers alone.
std::vector<double> log_ticks(double low, double high, int count) {
    const double decades = std::log10(high / low);
    std::vector<double> ticks;
    if (decades > 4) {
        const int step = static_cast<int>(std::ceil(decades / count));
        const int first = static_cast<int>(std::ceil(std::log10(low) / step)) * step;
        for (int power = first; std::pow(10, power) <= high; power += step) {
            ticks.push_back(std::pow(10, power));
        }
        return ticks;
    }
    for (double power = std::pow(10, std::floor(std::log10(low))); power <= high; power *= 10) {
        for (const double factor : {1.0, 2.0, 5.0}) {
            if (factor * power >= low && factor * power <= high) {
                ticks.push_back(factor * power);
            }
        }
    }
    return ticks;
}

} // namespace

std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2f", value);
    return text;
}

std::string text_at(double x, double y, const std::string& text, const std::string& style) {
    return "<text x='" + number(x) + "' y='" + number(y) + "' " + style + ">" + escape(text) +
           "</text>\n";
}

std::string line(double x1, double y1, double x2, double y2, const std::string& style) {
    return "<line x1='" + number(x1) + "' y1='" + number(y1) + "' x2='" + number(x2) + "' y2='" +
           number(y2) + "' " + style + "/>\n";
}

std::string polyline(const std::string& points, const std::string& style) {
    return "<polyline points='" + points + "' fill='none' " + style + "/>\n";
}

std::string document(double width, double height, const std::string& title,
                     const std::string& subtitle, const std::string& content) {
    std::string text = "<svg xmlns='http://www.w3.org/2000/svg' width='" + number(width) +
                       "' height='" + number(height) + "' viewBox='0 0 " + number(width) + " " +
                       number(height) + "' font-family='Helvetica, Arial, sans-serif' font-size='" +
                       number(font) +
                       "' fill='#333'>\n<rect width='100%' height='100%' fill='white'/>\n";
    text += text_at(80, 34, title, "font-size='19' fill='#111'");
    text += text_at(80, 56, subtitle, "fill='#666'");
    return text + content + "</svg>\n";
}

double Scale::at(double value) const {
    switch (spread) {
    case Spread::logarithmic:
        return std::log(value / low) / std::log(high / low);
    case Spread::listed: {
        const auto place = std::ranges::find(places, value) - places.begin();
        return (static_cast<double>(place) + 0.5) / static_cast<double>(places.size());
    }
    case Spread::even:
        break;
    }
    return (value - low) / (high - low);
}

std::vector<Scale::Tick> Scale::ticks(int count) const {
    std::vector<Tick> result;
    if (spread == Spread::listed) {
        for (size_t i = 0; i < places.size(); ++i) {
            result.push_back({places[i], names.empty() ? tick_text(places[i]) : names[i]});
        }
        return result;
    }
    for (const double value : spread == Spread::logarithmic ? log_ticks(low, high, count)
                                                            : even_ticks(low, high, count)) {
        result.push_back({value, tick_text(value)});
    }
    return result;
}

std::string Axes::draw(const std::string& x_label, const std::string& y_label) const {
    std::string text;
    const auto places = x_.ticks(8);
    // Labels that would run into one another go downwards.
    size_t longest = 0;
    for (const auto& place : places) {
        longest = std::max(longest, place.label.size());
    }
    const double wide = letter * static_cast<double>(longest);
    const bool slanted = x_.spread == Spread::listed &&
                         (wide + 6) * static_cast<double>(places.size()) > box_.right - box_.left;
    for (const auto& [value, label] : places) {
        text += line(x(value), box_.top, x(value), box_.bottom, "stroke='#e4e4e4'");
        text += slanted ? text_at(0, 0, label,
                                  "text-anchor='end' transform='translate(" + number(x(value) + 4) +
                                      " " + number(box_.bottom + 15) + ") rotate(-40)'")
                        : text_at(x(value), box_.bottom + 17, label, "text-anchor='middle'");
    }
    for (const auto& [value, label] : y_.ticks(6)) {
        text += line(box_.left, y(value), box_.right, y(value), "stroke='#e4e4e4'");
        text += text_at(box_.left - 7, y(value) + 4, label, "text-anchor='end'");
    }
    text += line(box_.left, box_.bottom, box_.right, box_.bottom, "stroke='#444'");
    text += line(box_.left, box_.top, box_.left, box_.bottom, "stroke='#444'");
    text += text_at((box_.left + box_.right) / 2, box_.bottom + (slanted ? 24 + 0.7 * wide : 38),
                    x_label, "text-anchor='middle'");
    return text + text_at(0, 0, y_label,
                          "text-anchor='middle' transform='translate(" + number(box_.left - 52) +
                              " " + number((box_.top + box_.bottom) / 2) + ") rotate(-90)'");
}

} // namespace ecir::cli::svg
