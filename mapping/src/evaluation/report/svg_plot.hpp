#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// Text for HTML and SVG, in elements and in quoted attributes.
[[nodiscard]] std::string escaped(std::string_view text);

/// An axis from `min` to `max` > min; both > 0 when logarithmic.
struct PlotAxis {
  std::string label;
  double min = 0.0;
  double max = 1.0;
  bool logarithmic = false;
  /// Names instead of numbers, at 0.5, 1.5, ... of a linear axis.
  std::vector<std::string> categories = {};
};

/// A drawing with two axes as inline SVG. What lies outside of the axes, infinities included, is
/// drawn on their edge. How things look is said by classes of the page's style sheet.
class SvgPlot {
 public:
  using Point = std::pair<double, double>;

  /// In units of the page's letters, which are 11 of them high.
  struct Size {
    double width = 360.0;
    double height = 260.0;
  };

  SvgPlot(PlotAxis x, PlotAxis y) : SvgPlot(std::move(x), std::move(y), Size{}) {}
  SvgPlot(PlotAxis x, PlotAxis y, Size size) : x_(std::move(x)), y_(std::move(y)), size_(size) {}

  /// Height over width of what lies between the axes.
  [[nodiscard]] static double aspect_of(Size size);

  void add_polygon(const std::vector<Point>& corners, std::string_view style);
  /// @param opacity  in [0, 1].
  void add_box(Point low, Point high, std::string_view style, double opacity = 1.0);
  void add_line(const std::vector<Point>& points, std::string_view style);
  /// From edge to edge.
  void add_vertical(double x, std::string_view style);
  void add_horizontal(double y, std::string_view style);
  /// Starts at the point.
  void add_text(Point at, std::string_view text, std::string_view style = "note");

  /// @param title  read out and shown by browsers when pointed at.
  [[nodiscard]] std::string svg(std::string_view title) const;

 private:
  [[nodiscard]] double right() const;
  [[nodiscard]] double bottom() const;
  [[nodiscard]] double pixel_x(double x) const;
  [[nodiscard]] double pixel_y(double y) const;
  [[nodiscard]] std::string pixels(const std::vector<Point>& points) const;
  [[nodiscard]] std::string x_axis() const;
  [[nodiscard]] std::string y_axis() const;

  PlotAxis x_;
  PlotAxis y_;
  Size size_;
  std::string content_;
};

}  // namespace stillmap::mapping
