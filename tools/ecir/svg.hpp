#pragma once
#include <array>
#include <string>
#include <vector>

/// Drawing charts as SVG: text that a browser shows as it is.
namespace ecir::cli::svg {

inline constexpr double font = 12;
inline constexpr double letter = 6.1; ///< mean width of a letter at that size

/// Distinct also to those who see few colours (Okabe and Ito).
inline constexpr std::array<const char*, 7> colours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
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

/// Pixels, two digits after the point.
std::string number(double value);
std::string text_at(double x, double y, const std::string& text, const std::string& style);
std::string line(double x1, double y1, double x2, double y2, const std::string& style);
/// Points as "x,y x,y ...".
std::string polyline(const std::string& points, const std::string& style);

/// A whole picture with a title, a line below it, and `content`.
std::string document(double width, double height, const std::string& title,
                     const std::string& subtitle, const std::string& content);

enum class Spread {
    even,        ///< linear
    logarithmic, ///< values above 0
    listed,      ///< each of `places` as far from the next, labelled one by one
};

/// What an axis shows and where on it, 0 its start and 1 its end, a value lies.
struct Scale {
    double low = 0;
    double high = 1;
    Spread spread = Spread::even;
    std::vector<double> places{};     ///< listed: the values in order
    std::vector<std::string> names{}; ///< listed: their labels; empty: the values themselves
    [[nodiscard]] double at(double value) const;
    struct Tick {
        double value;
        std::string label;
    };
    /// About `count` of them; more where the axis lists its values.
    [[nodiscard]] std::vector<Tick> ticks(int count) const;
};

/// The frame of a chart: grid, ticks, labels.
class Axes {
public:
    Axes(const Box& box, Scale x, Scale y) : box_(box), x_(std::move(x)), y_(std::move(y)) {}

    [[nodiscard]] double x(double value) const {
        return box_.left + (box_.right - box_.left) * x_.at(value);
    }
    [[nodiscard]] double y(double value) const {
        return box_.bottom - (box_.bottom - box_.top) * y_.at(value);
    }
    [[nodiscard]] const Box& box() const { return box_; }
    [[nodiscard]] std::string draw(const std::string& x_label, const std::string& y_label) const;

private:
    Box box_;
    Scale x_;
    Scale y_;
};

} // namespace ecir::cli::svg
