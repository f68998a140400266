#include "evaluation/localization/resampling.hpp"

#include "evaluation/localization/localization_metrics.hpp"
#include "evaluation/localization/prior_draws.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace stillmap::mapping {
namespace {

constexpr std::size_t kResamplings = 2000;
constexpr double kOutsideShare = 0.05;

ScanCount sum_of(const std::vector<ScanCount>& scans) {
  ScanCount sum;
  for (const ScanCount& scan : scans) {
    sum.count += scan.count;
    sum.of += scan.of;
  }
  return sum;
}

/// Probability of at most `count` of `whole` at a rate in (0, 1).
double binomial_at_most(std::size_t count, std::size_t whole, double rate) {
  const auto n = static_cast<double>(whole);
  double sum = 0.0;
  for (std::size_t i = 0; i <= count; ++i) {
    const auto k = static_cast<double>(i);
    sum += std::exp(std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0) +
                    k * std::log(rate) + (n - k) * std::log1p(-rate));
  }
  return sum;
}

}  // namespace

std::vector<ScanCount> counts_by_scan(const std::vector<LocalizationQuery>& queries,
                                      const std::function<bool(const LocalizationQuery&)>& happened,
                                      const std::function<bool(const LocalizationQuery&)>& among) {
  std::map<std::size_t, ScanCount> by_scan;
  for (const LocalizationQuery& query : queries) {
    if (!among(query)) continue;
    ScanCount& scan = by_scan[query.scan];
    ++scan.of;
    if (happened(query)) ++scan.count;
  }
  std::vector<ScanCount> scans;
  for (const auto& [scan, counts] : by_scan) scans.push_back(counts);
  return scans;
}

std::vector<double> resampled_rates(const std::vector<ScanCount>& scans, std::uint64_t seed) {
  std::vector<double> rates;
  if (scans.empty()) return rates;
  rates.reserve(kResamplings);
  for (std::size_t k = 0; k < kResamplings; ++k) {
    const CounterRandom random(seed, k, scans.size());
    ScanCount sum;
    for (std::size_t j = 0; j < scans.size(); ++j) {
      const auto drawn =
          static_cast<std::size_t>(random.uniform(j) * static_cast<double>(scans.size()));
      sum.count += scans[drawn].count;
      sum.of += scans[drawn].of;
    }
    rates.push_back(static_cast<double>(sum.count) / static_cast<double>(sum.of));
  }
  return rates;
}

double binomial_upper_95(std::size_t count, std::size_t whole) {
  if (whole == 0) return std::numeric_limits<double>::quiet_NaN();
  if (count >= whole) return 1.0;
  double low = static_cast<double>(count) / static_cast<double>(whole);
  double high = 1.0;
  // Halving to the last bits of a double.
  for (int i = 0; i < 52; ++i) {
    const double middle = 0.5 * (low + high);
    (binomial_at_most(count, whole, middle) > kOutsideShare ? low : high) = middle;
  }
  return high;
}

BoundedRate bounded_rate(const std::vector<ScanCount>& scans, std::uint64_t seed) {
  const ScanCount sum = sum_of(scans);
  BoundedRate rate;
  rate.count = sum.count;
  rate.of = sum.of;
  if (sum.of == 0) return rate;
  rate.rate = static_cast<double>(sum.count) / static_cast<double>(sum.of);
  // Rounded up, so that what happened once counts as once.
  const auto independent =
      static_cast<std::size_t>(std::ceil(rate.rate * static_cast<double>(scans.size()) - 1e-9));
  rate.upper_95 = std::max(percentile(resampled_rates(scans, seed), 1.0 - kOutsideShare),
                           binomial_upper_95(independent, scans.size()));
  return rate;
}

}  // namespace stillmap::mapping
