#include "tools/ecir/chart_svg.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "tools/ecir/svg.hpp"

namespace ecir::cli {
namespace {

using namespace svg;

constexpr double kWidth = 1120;
constexpr double kHeight = 900;
constexpr double kPanelWidth = 450;
constexpr double kPanelHeight = 330;

class Panel {
public:
    Panel(std::span<const ChartPoint> points, const std::vector<std::string>& models, double left,
          double top, ChartValue cost, ChartValue gain)
        : points_(points), models_(models), cost_(cost), gain_(gain),
          axes_({left, top, left + kPanelWidth, top + kPanelHeight}, costs(points, cost),
                gains(points, gain)) {}

    std::string draw(const std::string& x_label, const std::string& y_label) {
        return axes_.draw(x_label, y_label) + front() + marks() + labels();
    }

private:
    static Scale costs(std::span<const ChartPoint> points, ChartValue cost) {
        const auto [least, most] = std::ranges::minmax(points, {}, cost);
        return {least.*cost / 1.5, most.*cost * 1.9, Spread::logarithmic};
    }
    static Scale gains(std::span<const ChartPoint> points, ChartValue gain) {
        const auto [least, most] = std::ranges::minmax(points, {}, gain);
        const double range = most.*gain - least.*gain;
        const double margin = range > 0 ? 0.12 * range : 0.01;
        return {least.*gain - margin, most.*gain + margin};
    }
    [[nodiscard]] double x(const ChartPoint& point) const { return axes_.x(point.*cost_); }
    [[nodiscard]] double y(const ChartPoint& point) const { return axes_.y(point.*gain_); }
    [[nodiscard]] const char* colour(const ChartPoint& point) const {
        const auto place = std::ranges::find(models_, point.model) - models_.begin();
        return colours.at(static_cast<size_t>(place) % colours.size());
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
        return polyline(path, "stroke='#999' stroke-width='1.5' stroke-dasharray='5 4'");
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
        const double wide = letter * static_cast<double>(name.size());
        const std::array<std::array<double, 2>, 6> places = {
            {{10, 4}, {-10 - wide, 4}, {-wide / 2, -11}, {-wide / 2, 20}, {8, -9}, {8, 18}}};
        for (const auto& [dx, dy] : places) {
            const double left = x(point) + dx;
            const double base = y(point) + dy;
            const Box box{left - 1, base - font, left + wide + 1, base + 3};
            const bool inside = box.left > axes_.box().left && box.right < axes_.box().right + 40 &&
                                box.top > axes_.box().top - 14 && box.bottom < axes_.box().bottom;
            if (inside && std::ranges::none_of(taken, [&](const Box& b) { return b.meets(box); })) {
                taken.push_back(box);
                return text_at(left, base, name, "fill='" + std::string(colour(point)) + "'");
            }
        }
        return "";
    }

    std::span<const ChartPoint> points_;
    const std::vector<std::string>& models_;
    ChartValue cost_;
    ChartValue gain_;
    Axes axes_;
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
    std::string text;
    for (size_t row = 0; row < rows.size(); ++row) {
        for (size_t column = 0; column < columns.size(); ++column) {
            Panel panel(points, models, columns.at(column), rows.at(row), costs.at(column).value,
                        gains.at(row).value);
            text += panel.draw(costs.at(column).label, gains.at(row).label);
        }
    }
    return document(kWidth, kHeight, title, subtitle, text);
}

} // namespace ecir::cli
