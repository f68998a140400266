#include "drives/value_step.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <vector>

namespace stillmap::maps {
namespace {

/// Of the step, by which a difference may miss a multiple: floats are printed with few digits too.
constexpr double kMiss = 0.02;
/// As many gaps between different values must be multiples: by chance one in 25 is.
constexpr std::size_t kFewestGaps = 4;
/// Even motion makes multiples as well: neighbours must be different numbers of steps apart.
constexpr double kMostAlike = 0.9;

/// Whether nearly all neighbours are as many steps apart.
bool differ_evenly(std::span<const double> values, double step) {
  std::map<long, std::size_t> counts;
  for (std::size_t i = 1; i < values.size(); ++i)
    ++counts[std::lround(std::abs(values[i] - values[i - 1]) / step)];
  counts.erase(0);
  std::size_t most = 0;
  for (const auto& [steps, count] : counts) most = std::max(most, count);
  return static_cast<double>(most) > kMostAlike * static_cast<double>(values.size() - 1);
}

/// The largest power of ten that all values are multiples of, down to 0.1; 0 for none.
double decimal_step_of(std::span<const double> values) {
  for (const double step : {1000.0, 100.0, 10.0, 1.0, 0.1}) {
    const auto is_multiple = [&](double value) {
      return std::abs(value / step - std::round(value / step)) < 1e-6;
    };
    if (std::ranges::all_of(values, is_multiple)) return step;
  }
  return 0.0;
}

}  // namespace

double step_of(std::span<const double> values) {
  std::vector<double> sorted(values.begin(), values.end());
  std::ranges::sort(sorted);
  std::vector<double> gaps;
  for (std::size_t i = 1; i < sorted.size(); ++i)
    if (sorted[i] > sorted[i - 1]) gaps.push_back(sorted[i] - sorted[i - 1]);
  if (gaps.empty()) return 0.0;
  // Of a few different values their digits tell more than what lies between them.
  if (gaps.size() < kFewestGaps) {
    const double step = decimal_step_of(values);
    return step == 0.0 || differ_evenly(values, step) ? 0.0 : step;
  }
  std::ranges::sort(gaps);
  double step = gaps.front(), sum = 0.0, steps = 0.0;
  for (const double gap : gaps) {
    const double multiple = std::round(gap / step);
    if (std::abs(gap - multiple * step) > kMiss * step) return 0.0;
    if (multiple > 1.0 && steps > 100.0) continue;
    sum += gap;
    steps += multiple;
    step = sum / steps;
  }
  return differ_evenly(values, step) ? 0.0 : step;
}

}  // namespace stillmap::maps
