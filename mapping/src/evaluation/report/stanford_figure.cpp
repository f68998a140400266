#include "evaluation/report/figures.hpp"
#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <stdexcept>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kLow = 1e-3;
constexpr double kHigh = 10.0;
constexpr int kCells = 64;

struct Cell {
  std::size_t count = 0;
  bool misleads = false;
};

struct Words {
  std::string name;
  std::string unit;
  /// Of the unit that is shown.
  double scale = 1.0;
};

Words words_of(Axis axis) {
  switch (axis) {
    case Axis::kLongitudinal:
      return {"longitudinal", "m", 1.0};
    case Axis::kLateral:
      return {"lateral", "m", 1.0};
    case Axis::kYaw:
      return {"yaw", "deg", 180.0 / std::numbers::pi};
    case Axis::kVertical:
      break;
  }
  throw std::invalid_argument("stanford_figure: an axis without an alert limit");
}

int cell_of(double value) {
  const double place = std::log(std::clamp(value, kLow, kHigh) / kLow) / std::log(kHigh / kLow);
  return std::min(static_cast<int>(place * kCells), kCells - 1);
}

double edge_of(int cell) {
  return kLow * std::pow(kHigh / kLow, static_cast<double>(cell) / kCells);
}

void draw_regions(SvgPlot& plot, double limit) {
  plot.add_polygon({{kLow, kLow}, {kLow, limit}, {limit, limit}}, "nominal");
  plot.add_polygon({{kLow, kLow}, {limit, limit}, {limit, kLow}}, "misleading");
  plot.add_polygon({{limit, kLow}, {limit, limit}, {kHigh, limit}, {kHigh, kLow}}, "hazardous");
  plot.add_polygon({{kLow, limit}, {kLow, kHigh}, {kHigh, kHigh}, {kHigh, limit}}, "unavailable");
}

void name_regions(SvgPlot& plot, double limit) {
  plot.add_line({{kLow, kLow}, {kHigh, kHigh}}, "diagonal");
  plot.add_horizontal(limit, "mark");
  plot.add_text({1.3 * kLow, 0.6 * kHigh}, "unavailable");
  plot.add_text({1.3 * kLow, 0.68 * limit}, "nominal");
  plot.add_text({12.0 * kLow, 1.4 * kLow}, "misleading");
  plot.add_text({1.15 * limit, 1.4 * kLow}, "hazardous");
}

}  // namespace

std::string stanford_figure(const std::vector<LocalizationQuery>& queries, Axis axis) {
  const Words words = words_of(axis);
  const double limit = words.scale * alert_limit_of(axis);
  std::map<std::pair<int, int>, Cell> cells;
  std::size_t most = 1;
  for (const LocalizationQuery& query : queries) {
    if (query.status != localization::PoseStatus::kOk) continue;
    const double error = error_along(query, axis);
    const double level = level_along(query, axis);
    Cell& cell = cells[{cell_of(words.scale * error), cell_of(words.scale * level)}];
    most = std::max(most, ++cell.count);
    cell.misleads = cell.misleads || !(error <= level);
  }
  SvgPlot plot({.label = fmt::format("{} error [{}]", words.name, words.unit),
                .min = kLow,
                .max = kHigh,
                .logarithmic = true},
               {.label = fmt::format("{} level [{}]", words.name, words.unit),
                .min = kLow,
                .max = kHigh,
                .logarithmic = true});
  draw_regions(plot, limit);
  for (const auto& [place, cell] : cells) {
    const double density =
        std::log1p(static_cast<double>(cell.count)) / std::log1p(static_cast<double>(most));
    plot.add_box({edge_of(place.first), edge_of(place.second)},
                 {edge_of(place.first + 1), edge_of(place.second + 1)},
                 cell.misleads ? "wrong" : "fill c0", cell.misleads ? 1.0 : 0.25 + 0.75 * density);
  }
  name_regions(plot, limit);
  return plot.svg(fmt::format("Protection level against true error, {}", words.name));
}

}  // namespace stillmap::mapping
