#include "evaluation/report/figures.hpp"

#include "evaluation/report/svg_plot.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kColours = 6;
constexpr double kPercent = 100.0;

double in_degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

PlotAxis percent_axis(std::string label) {
  return {.label = std::move(label), .min = 0.0, .max = kPercent};
}

/// Steps of the share of `values` below each value, from 0 to 100 %; infinite ones never come.
std::vector<SvgPlot::Point> steps_of(std::vector<double> values, const PlotAxis& x) {
  std::sort(values.begin(), values.end());
  std::vector<SvgPlot::Point> points{{x.min, 0.0}};
  double share = 0.0;
  for (std::size_t i = 0; i < values.size() && std::isfinite(values[i]); ++i) {
    const double next = kPercent * static_cast<double>(i + 1) / static_cast<double>(values.size());
    // A step that is too small to be seen is not worth its bytes.
    const bool last = i + 1 == values.size() || !std::isfinite(values[i + 1]);
    if (next - share < 0.2 && !last) continue;
    points.emplace_back(values[i], share);
    points.emplace_back(values[i], next);
    share = next;
  }
  points.emplace_back(x.max, share);
  return points;
}

std::string distribution(const LocalizationEvaluation& evaluation, const PlotAxis& x,
                         const std::vector<double>& marks, const std::string& title,
                         const std::function<double(const LocalizationQuery&)>& value) {
  SvgPlot plot(x, percent_axis("share of queries [%]"));
  for (const double mark : marks) plot.add_vertical(mark, "mark");
  for (std::size_t level = 0; level < evaluation.queries.size(); ++level) {
    std::vector<double> values;
    for (const LocalizationQuery& query : evaluation.queries[level]) values.push_back(value(query));
    if (!values.empty()) plot.add_line(steps_of(std::move(values), x), style_of_level(level));
  }
  return plot.svg(title);
}

double infinite_if_lost(const LocalizationQuery& query, double value) {
  return query.status == localization::PoseStatus::kLost ? std::numeric_limits<double>::infinity()
                                                         : value;
}

}  // namespace

std::string name_of(const LocalizationLevel& level, PriorSource source) {
  if (source == PriorSource::kNone) return "no prior";
  if (source == PriorSource::kPrevious) return "scan before";
  return fmt::format("{:.3g} m, {:.3g} deg", level.prior_error.metres, level.prior_error.degrees);
}

std::string style_of_level(std::size_t level) { return fmt::format("c{}", level % kColours); }

std::string success_figure(const LocalizationEvaluation& evaluation) {
  PlotAxis x{.label = "prior off by", .max = static_cast<double>(evaluation.levels.size())};
  for (const LocalizationLevel& level : evaluation.levels)
    x.categories.push_back(name_of(level, evaluation.options.prior));
  SvgPlot plot(x, percent_axis("success [%]"));
  for (std::size_t i = 0; i < evaluation.levels.size(); ++i) {
    const LocalizationLevel& level = evaluation.levels[i];
    const double middle = static_cast<double>(i) + 0.5;
    plot.add_box({middle - 0.3, 0.0}, {middle + 0.3, kPercent * level.success_rate},
                 "fill " + style_of_level(i), 0.75);
    const double low = kPercent * level.success_interval[0];
    const double high = kPercent * level.success_interval[1];
    plot.add_line({{middle, low}, {middle, high}}, "whisker");
    plot.add_line({{middle - 0.06, low}, {middle + 0.06, low}}, "whisker");
    plot.add_line({{middle - 0.06, high}, {middle + 0.06, high}}, "whisker");
    plot.add_text({middle, 4.0}, fmt::format("{:.2f} %", kPercent * level.success_rate),
                  "value middle");
  }
  return plot.svg("Success by prior error");
}

std::string translation_figure(const LocalizationEvaluation& evaluation) {
  return distribution(
      evaluation, {.label = "translation error [m]", .min = 1e-3, .max = 10.0, .logarithmic = true},
      {0.2}, "Distribution of the translation error", [](const LocalizationQuery& query) {
        return infinite_if_lost(query, query.error.head<3>().norm());
      });
}

std::string yaw_figure(const LocalizationEvaluation& evaluation) {
  return distribution(evaluation,
                      {.label = "yaw error [deg]", .min = 1e-3, .max = 10.0, .logarithmic = true},
                      {1.0}, "Distribution of the yaw error", [](const LocalizationQuery& query) {
                        return infinite_if_lost(query, in_degrees(std::abs(query.error[5])));
                      });
}

std::string latency_figure(const LocalizationEvaluation& evaluation) {
  return distribution(
      evaluation, {.label = "CPU time [ms]", .min = 1.0, .max = 10000.0, .logarithmic = true}, {},
      "Distribution of the CPU time", [](const LocalizationQuery& query) { return query.cpu_ms; });
}

std::string nees_figure(const std::vector<LocalizationQuery>& queries) {
  constexpr std::size_t kBins = 30;
  constexpr double kEnd = 30.0;
  constexpr double kWidth = kEnd / kBins;
  std::vector<double> counts(kBins + 1, 0.0);
  double all = 0.0;
  for (const LocalizationQuery& query : queries) {
    if (std::isnan(query.nees)) continue;
    ++counts[static_cast<std::size_t>(std::min(query.nees / kWidth, static_cast<double>(kBins)))];
    ++all;
  }
  const double highest = all > 0.0 ? *std::max_element(counts.begin(), counts.end()) / all : 0.0;
  SvgPlot plot({.label = "NEES (beyond 30 in the last bar)", .max = kEnd + kWidth},
               {.label = "share [%]", .max = std::max(16.0, 105.0 * highest)});
  for (std::size_t i = 0; all > 0.0 && i <= kBins; ++i) {
    const double left = kWidth * static_cast<double>(i);
    plot.add_box({left, 0.0}, {left + 0.9 * kWidth, kPercent * counts[i] / all},
                 i == kBins ? "fill beyond" : "fill c0", 0.75);
  }
  std::vector<SvgPlot::Point> density;
  // x^2 exp(-x / 2) / 16 is the density for 6 degrees of freedom.
  for (double x = 0.0; x <= kEnd; x += 0.25)
    density.emplace_back(x, kPercent * kWidth * x * x * std::exp(-0.5 * x) / 16.0);
  plot.add_line(density, "theory");
  plot.add_vertical(12.592, "mark");
  return plot.svg("Squared error in units of the covariance");
}

}  // namespace stillmap::mapping
