#include "tools/ecir/chart_svg.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>

namespace ecir::cli {
namespace {

constexpr double kWidth = 1120;
constexpr double kHeight = 900;
constexpr double kPanelWidth = 450;
constexpr double kPanelHeight = 330;
constexpr double kFont = 12;
constexpr double kLetter = 6.1; ///< mean width of a letter at kFont

/// Distinct also to those who see few colours (Okabe and Ito).
constexpr std::array<const char*, 7> kColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                                 "#e69f00", "#56b4e9", "#555555"};

struct Box {
    double left;
    double top;
    double right;
    double bottom;
    [[nodiscard]] bool meets(const Box& other) const {
        return left < other.right && other.left < right && top < other.bottom && other.top < bottom;
    }
};

std::string number(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.2f", value);
    return text;
}

std::string escape(const std::string& text) {
    std::string result;
    for (const char c : text) {
        result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : std::string(1, c);
    }
    return result;
}

std::string text_at(double x, double y, const std::string& text, const std::string& style) {
    return "<text x='" + number(x) + "' y='" + number(y) + "' " + style + ">" + escape(text) +
           "</text>\n";
}

std::string line(double x1, double y1, double x2, double y2, const std::string& style) {
    return "<line x1='" + number(x1) + "' y1='" + number(y1) + "' x2='" + number(x2) + "' y2='" +
           number(y2) + "' " + style + "/>\n";
}

/// Labels at steps of 1, 2 or 5 times a power of ten, about `count` of them in [low, high].
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

/// 1, 2 and 5 times the powers of ten in [low, high].
std::vector<double> log_ticks(double low, double high) {
    std::vector<double> ticks;
    for (double power = std::pow(10, std::floor(std::log10(low))); power <= high; power *= 10) {
        for (const double factor : {1.0, 2.0, 5.0}) {
            if (factor * power >= low && factor * power <= high) {
                ticks.push_back(factor * power);
            }
        }
    }
    return ticks;
}

std::string tick_text(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.6g", value);
    return text;
}

class Panel {
public:
    Panel(std::span<const ChartPoint> points, const std::vector<std::string>& models, double left,
          double top, ChartValue cost, ChartValue gain)
        : points_(points), models_(models), left_(left), top_(top), cost_(cost), gain_(gain) {
        const auto costs =
            std::minmax_element(points.begin(), points.end(),
                                [&](const auto& a, const auto& b) { return a.*cost < b.*cost; });
        const auto gains =
            std::minmax_element(points.begin(), points.end(),
                                [&](const auto& a, const auto& b) { return a.*gain < b.*gain; });
        x_low_ = *costs.first.*cost / 1.5;
        x_high_ = *costs.second.*cost * 1.9;
        const double range = *gains.second.*gain - *gains.first.*gain;
        const double margin = range > 0 ? 0.12 * range : 0.01;
        y_low_ = *gains.first.*gain - margin;
        y_high_ = *gains.second.*gain + margin;
    }

    std::string draw(const std::string& x_label, const std::string& y_label) {
        return frame(x_label, y_label) + front() + marks() + labels();
    }

private:
    [[nodiscard]] double x(const ChartPoint& point) const { return x_of(point.*cost_); }
    [[nodiscard]] double y(const ChartPoint& point) const { return y_of(point.*gain_); }
    [[nodiscard]] double x_of(double value) const {
        return left_ + kPanelWidth * std::log(value / x_low_) / std::log(x_high_ / x_low_);
    }
    [[nodiscard]] double y_of(double value) const {
        return top_ + kPanelHeight * (y_high_ - value) / (y_high_ - y_low_);
    }
    [[nodiscard]] const char* colour(const ChartPoint& point) const {
        const auto place = std::ranges::find(models_, point.model) - models_.begin();
        return kColours.at(static_cast<size_t>(place) % kColours.size());
    }

    [[nodiscard]] std::string frame(const std::string& x_label, const std::string& y_label) const {
        const double bottom = top_ + kPanelHeight;
        std::string text;
        for (const double tick : log_ticks(x_low_, x_high_)) {
            text += line(x_of(tick), top_, x_of(tick), bottom, "stroke='#e4e4e4'");
            text += text_at(x_of(tick), bottom + 17, tick_text(tick), "text-anchor='middle'");
        }
        for (const double tick : even_ticks(y_low_, y_high_, 6)) {
            text += line(left_, y_of(tick), left_ + kPanelWidth, y_of(tick), "stroke='#e4e4e4'");
            text += text_at(left_ - 7, y_of(tick) + 4, tick_text(tick), "text-anchor='end'");
        }
        text += line(left_, bottom, left_ + kPanelWidth, bottom, "stroke='#444'");
        text += line(left_, top_, left_, bottom, "stroke='#444'");
        text += text_at(left_ + kPanelWidth / 2, bottom + 38, x_label, "text-anchor='middle'");
        text += text_at(0, 0, y_label,
                        "text-anchor='middle' transform='translate(" + number(left_ - 52) + " " +
                            number(top_ + kPanelHeight / 2) + ") rotate(-90)'");
        return text;
    }

    std::string front() {
        const auto is_front = pareto_front(points_, cost_, gain_);
        for (size_t i = 0; i < points_.size(); ++i) {
            if (is_front[i]) {
                front_.push_back(i);
            }
        }
        std::ranges::sort(front_, {}, [&](size_t i) { return points_[i].*cost_; });
        std::string path;
        for (const size_t i : front_) {
            path += number(x(points_[i])) + "," + number(y(points_[i])) + " ";
        }
        return "<polyline points='" + path +
               "' fill='none' stroke='#999' stroke-width='1.5' stroke-dasharray='5 4'/>\n";
    }

    [[nodiscard]] std::string marks() const {
        std::string text;
        for (const ChartPoint& point : points_) {
            const std::string fill = point.scale == 1 ? colour(point) : "white";
            text += "<circle cx='" + number(x(point)) + "' cy='" + number(y(point)) +
                    "' r='5.5' fill='" + fill + "' stroke='" + colour(point) +
                    "' stroke-width='2'/>\n";
        }
        return text;
    }

    /// Names of the front first, then of the others as far as there is room.
    [[nodiscard]] std::string labels() const {
        std::vector<size_t> order = front_;
        for (size_t i = 0; i < points_.size(); ++i) {
            if (std::ranges::find(front_, i) == front_.end()) {
                order.push_back(i);
            }
        }
        std::vector<Box> taken;
        for (const ChartPoint& point : points_) {
            taken.push_back({x(point) - 6, y(point) - 6, x(point) + 6, y(point) + 6});
        }
        std::string text;
        for (const size_t i : order) {
            text += label(i, taken);
        }
        return text;
    }

    [[nodiscard]] std::string label(size_t index, std::vector<Box>& taken) const {
        const ChartPoint& point = points_[index];
        const std::string name = point.name();
        const double wide = kLetter * static_cast<double>(name.size());
        const std::array<std::array<double, 2>, 6> places = {
            {{10, 4}, {-10 - wide, 4}, {-wide / 2, -11}, {-wide / 2, 20}, {8, -9}, {8, 18}}};
        for (const auto& [dx, dy] : places) {
            const double left = x(point) + dx;
            const double base = y(point) + dy;
            const Box box{left - 1, base - kFont, left + wide + 1, base + 3};
            const bool inside = box.left > left_ && box.right < left_ + kPanelWidth + 40 &&
                                box.top > top_ - 14 && box.bottom < top_ + kPanelHeight;
            if (inside && std::ranges::none_of(taken, [&](const Box& b) { return b.meets(box); })) {
                taken.push_back(box);
                return text_at(left, base, name, "fill='" + std::string(colour(point)) + "'");
            }
        }
        return "";
    }

    std::span<const ChartPoint> points_;
    const std::vector<std::string>& models_;
    double left_;
    double top_;
    ChartValue cost_;
    ChartValue gain_;
    double x_low_ = 0;
    double x_high_ = 0;
    double y_low_ = 0;
    double y_high_ = 0;
    std::vector<size_t> front_; ///< by rising cost
};

} // namespace

std::string chart_svg(std::span<const ChartPoint> points, const std::string& title,
                      const std::string& subtitle) {
    std::vector<std::string> models;
    for (const ChartPoint& point : points) {
        if (std::ranges::find(models, point.model) == models.end()) {
            models.push_back(point.model);
        }
    }
    std::string text = "<svg xmlns='http://www.w3.org/2000/svg' width='" + number(kWidth) +
                       "' height='" + number(kHeight) + "' viewBox='0 0 " + number(kWidth) + " " +
                       number(kHeight) +
                       "' font-family='Helvetica, Arial, sans-serif' font-size='" + number(kFont) +
                       "' fill='#333'>\n<rect width='100%' height='100%' fill='white'/>\n";
    text += text_at(80, 34, title, "font-size='19' fill='#111'");
    text += text_at(80, 56, subtitle, "fill='#666'");
    const std::array<double, 2> columns = {80, 630};
    const std::array<double, 2> rows = {90, 495};
    struct Axis {
        ChartValue value;
        const char* label;
    };
    const std::array<Axis, 2> costs = {{{&ChartPoint::ms, "milliseconds for a blurry frame"},
                                        {&ChartPoint::gflop, "GFLOP for a blurry frame"}}};
    const std::array<Axis, 2> gains = {
        {{&ChartPoint::psnr, "PSNR, dB"}, {&ChartPoint::ssim, "SSIM"}}};
    for (size_t row = 0; row < rows.size(); ++row) {
        for (size_t column = 0; column < columns.size(); ++column) {
            Panel panel(points, models, columns.at(column), rows.at(row), costs.at(column).value,
                        gains.at(row).value);
            text += panel.draw(costs.at(column).label, gains.at(row).label);
        }
    }
    return text + "</svg>\n";
}

} // namespace ecir::cli
