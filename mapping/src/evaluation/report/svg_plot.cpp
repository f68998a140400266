#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr double kLeft = 52.0;
constexpr double kTop = 10.0;
constexpr double kBesideRight = 12.0;
constexpr double kBelow = 44.0;

/// Where a value lies between the ends of an axis, in [0, 1].
double place_on(const PlotAxis& axis, double value) {
  const double inside = std::clamp(std::isnan(value) ? axis.min : value, axis.min, axis.max);
  return axis.logarithmic ? std::log(inside / axis.min) / std::log(axis.max / axis.min)
                          : (inside - axis.min) / (axis.max - axis.min);
}

std::vector<double> ticks_of(const PlotAxis& axis) {
  std::vector<double> ticks;
  if (axis.logarithmic) {
    for (double decade = std::pow(10.0, std::ceil(std::log10(axis.min) - 1e-9));
         decade <= axis.max * (1.0 + 1e-9); decade *= 10.0) {
      ticks.push_back(decade);
    }
    return ticks;
  }
  // Four to eight round steps.
  const double rough = (axis.max - axis.min) / 5.0;
  const double power = std::pow(10.0, std::floor(std::log10(rough)));
  const double ratio = rough / power;
  const double step = power * (ratio < 1.5 ? 1.0 : ratio < 3.5 ? 2.0 : ratio < 7.5 ? 5.0 : 10.0);
  for (double k = std::ceil(axis.min / step - 1e-9); k * step <= axis.max + 1e-9 * step; ++k)
    ticks.push_back(k * step + 0.0);  // turns -0 into 0
  return ticks;
}

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  for (const char letter : text) {
    switch (letter) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += letter;
    }
  }
  return out;
}

double SvgPlot::aspect_of(Size size) {
  return (size.height - kTop - kBelow) / (size.width - kLeft - kBesideRight);
}

double SvgPlot::right() const { return size_.width - kBesideRight; }
double SvgPlot::bottom() const { return size_.height - kBelow; }
double SvgPlot::pixel_x(double x) const { return kLeft + place_on(x_, x) * (right() - kLeft); }
double SvgPlot::pixel_y(double y) const { return bottom() - place_on(y_, y) * (bottom() - kTop); }

std::string SvgPlot::pixels(const std::vector<Point>& points) const {
  std::string out;
  for (const auto& [x, y] : points) out += fmt::format("{:.1f},{:.1f} ", pixel_x(x), pixel_y(y));
  return out;
}

void SvgPlot::add_polygon(const std::vector<Point>& corners, std::string_view style) {
  content_ += fmt::format("<polygon class=\"{}\" points=\"{}\"/>\n", style, pixels(corners));
}

void SvgPlot::add_box(Point low, Point high, std::string_view style, double opacity) {
  const double left = pixel_x(low.first);
  const double top = pixel_y(high.second);
  content_ += fmt::format(
      "<rect class=\"{}\" x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" "
      "fill-opacity=\"{:.2f}\"/>\n",
      style, left, top, pixel_x(high.first) - left, pixel_y(low.second) - top, opacity);
}

void SvgPlot::add_line(const std::vector<Point>& points, std::string_view style) {
  content_ += fmt::format("<polyline class=\"line {}\" points=\"{}\"/>\n", style, pixels(points));
}

void SvgPlot::add_vertical(double x, std::string_view style) {
  add_line({{x, y_.min}, {x, y_.max}}, style);
}

void SvgPlot::add_horizontal(double y, std::string_view style) {
  add_line({{x_.min, y}, {x_.max, y}}, style);
}

void SvgPlot::add_text(Point at, std::string_view text, std::string_view style) {
  content_ += fmt::format("<text class=\"{}\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", style,
                          pixel_x(at.first), pixel_y(at.second), escaped(text));
}

std::string SvgPlot::x_axis() const {
  std::string out;
  const auto label = [&](double x, std::string_view text) {
    out += fmt::format("<text class=\"tick middle\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", x,
                       bottom() + 15.0, escaped(text));
  };
  for (std::size_t i = 0; i < x_.categories.size(); ++i)
    label(pixel_x(static_cast<double>(i) + 0.5), x_.categories[i]);
  if (x_.categories.empty()) {
    for (const double tick : ticks_of(x_)) {
      const double x = pixel_x(tick);
      out += fmt::format("<path class=\"grid\" d=\"M{:.1f} {:.1f}V{:.1f}\"/>\n", x, kTop, bottom());
      label(x, fmt::format("{:.6g}", tick));
    }
  }
  out += fmt::format("<text class=\"label middle\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n",
                     0.5 * (kLeft + right()), size_.height - 10.0, escaped(x_.label));
  return out;
}

std::string SvgPlot::y_axis() const {
  std::string out;
  for (const double tick : ticks_of(y_)) {
    const double y = pixel_y(tick);
    out += fmt::format(
        "<path class=\"grid\" d=\"M{:.1f} {:.1f}H{:.1f}\"/>\n"
        "<text class=\"tick end\" x=\"{:.1f}\" y=\"{:.1f}\">{:.6g}</text>\n",
        kLeft, y, right(), kLeft - 6.0, y + 4.0, tick);
  }
  const double middle = 0.5 * (kTop + bottom());
  out += fmt::format(
      "<text class=\"label middle\" transform=\"translate(13 {:.1f}) rotate(-90)\">{}</text>\n",
      middle, escaped(y_.label));
  return out;
}

std::string SvgPlot::svg(std::string_view title) const {
  return fmt::format(
      "<svg viewBox=\"0 0 {} {}\" role=\"img\"><title>{}</title>\n{}{}{}"
      "<rect class=\"frame\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/></svg>\n",
      size_.width, size_.height, escaped(title), x_axis(), y_axis(), content_, kLeft, kTop,
      right() - kLeft, bottom() - kTop);
}

}  // namespace stillmap::mapping
