#include "evaluation/odometry/table_differences.hpp"

#include "evaluation/paper/street_draws.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

namespace stillmap::mapping {
namespace {

constexpr double kNoFigure = std::numeric_limits<double>::quiet_NaN();
/// 97.5 % point of a normal distribution, which `stretch_of` stretches.
constexpr double kNormal = 1.959964;

const PathFigures& figures_of(const OdometryTableRun& run, bool loops) {
  return loops ? run.with_loops : run.without_loops;
}

OdometryTableDifference difference(const std::vector<OdometryTableRun>& runs,
                                   const std::string& method, bool loops, MovablePolicy points) {
  OdometryTableDifference out;
  out.method = method;
  out.loops = loops;
  out.points = points;
  std::vector<double> ape_m, percent;
  for (const OdometryTableRun& raw : runs) {
    if (raw.method != method || raw.points != MovablePolicy::kKeep) continue;
    for (const OdometryTableRun& run : runs) {
      if (run.method != method || run.points != points || run.drive != raw.drive) continue;
      const PathFigures& from = figures_of(raw, loops);
      const PathFigures& to = figures_of(run, loops);
      const double change_m = to.ape_mean_m - from.ape_mean_m;
      if (!std::isfinite(change_m)) continue;
      ape_m.push_back(change_m);
      out.better += change_m < 0.0 ? 1 : 0;
      if (const double change = to.percent_10m - from.percent_10m; std::isfinite(change))
        percent.push_back(change);
    }
  }
  out.drives = ape_m.size();
  out.ape_mean_m = mean_interval(ape_m);
  out.percent_10m = mean_interval(percent);
  return out;
}

}  // namespace

Interval mean_interval(const std::vector<double>& values) {
  if (values.empty()) return {kNoFigure, kNoFigure, kNoFigure};
  const auto count = static_cast<double>(values.size());
  double mean = 0.0;
  for (const double value : values) mean += value / count;
  if (values.size() < 2) return {mean, kNoFigure, kNoFigure};
  double variance = 0.0;
  for (const double value : values) variance += (value - mean) * (value - mean) / count;
  const double half = kNormal * stretch_of(values.size()) * std::sqrt(variance / count);
  return {mean, mean - half, mean + half};
}

std::vector<OdometryTableDifference> differences_of(const std::vector<OdometryTableRun>& runs) {
  std::vector<std::string> methods;
  for (const OdometryTableRun& run : runs) {
    if (std::find(methods.begin(), methods.end(), run.method) == methods.end())
      methods.push_back(run.method);
  }
  std::vector<OdometryTableDifference> differences;
  for (const std::string& method : methods) {
    for (const bool loops : {false, true}) {
      for (const MovablePolicy points : {MovablePolicy::kProject, MovablePolicy::kDelete})
        differences.push_back(difference(runs, method, loops, points));
    }
  }
  return differences;
}

}  // namespace stillmap::mapping
