#include "evaluation/paper/street_draws.hpp"

#include "evaluation/localization/localization_metrics.hpp"
#include "evaluation/localization/prior_draws.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr double kNormal975 = 1.959964;

std::size_t below(double uniform, std::size_t count) {
  return std::min(static_cast<std::size_t>(uniform * static_cast<double>(count)), count - 1);
}

std::size_t blocks_of(std::size_t scans) {
  return (scans + StreetDraws::kBlockScans - 1) / StreetDraws::kBlockScans;
}

/// 97.5 % point of Student's distribution, to 0.1 %: a table where the expansion is too coarse.
/// @see Abramowitz, Stegun, 26.7.5.
double student_975(std::size_t freedom) {
  constexpr std::array kFew{12.706, 4.303, 3.182, 2.776, 2.571};
  if (freedom <= kFew.size()) return kFew[freedom - 1];
  const double z = kNormal975;
  const auto n = static_cast<double>(freedom);
  return z + (std::pow(z, 3) + z) / (4.0 * n) +
         (5.0 * std::pow(z, 5) + 16.0 * std::pow(z, 3) + 3.0 * z) / (96.0 * n * n);
}

}  // namespace

double stretch_of(std::size_t clusters) {
  if (clusters < 2) throw std::invalid_argument("clusters: fewer than 2");
  const auto n = static_cast<double>(clusters);
  return std::sqrt(n / (n - 1.0)) * student_975(clusters - 1) / kNormal975;
}

StreetDraws::StreetDraws(const std::vector<std::size_t>& scans, std::uint64_t seed) {
  std::vector<std::size_t> first;
  for (const std::size_t count : scans) {
    if (count == 0) throw std::invalid_argument("street: 0 scans, >= 1");
    first.push_back(scans_);
    scans_ += count;
    blocks_ += blocks_of(count);
  }
  if (scans.empty()) throw std::invalid_argument("streets: none, at least one");
  const std::size_t clusters = scans.size() > 1 ? scans.size() : blocks_;
  stretch_ = clusters > 1 ? stretch_of(clusters) : std::numeric_limits<double>::quiet_NaN();
  weights_.resize(kDraws * scans_);
  for (std::size_t draw = 0; draw < kDraws; ++draw) {
    std::uint16_t* const weights = weights_.data() + draw * scans_;
    const CounterRandom random(seed, draw, scans_);
    std::size_t number = 0;
    for (std::size_t k = 0; k < scans.size(); ++k) {
      const std::size_t street = below(random.uniform(number++), scans.size());
      const std::size_t count = scans[street];
      std::size_t at = 0;
      for (std::size_t i = 0; i < count; ++i) {
        at = i % kBlockScans == 0 ? below(random.uniform(number++), count) : (at + 1) % count;
        ++weights[first[street] + at];
      }
    }
  }
}

Interval StreetDraws::interval(const std::function<double(Weights)>& figure) const {
  const std::vector<std::uint16_t> once(scans_, 1);
  Interval out;
  out.value = figure(once);
  std::vector<double> drawn;
  drawn.reserve(kDraws);
  for (std::size_t draw = 0; draw < kDraws; ++draw) drawn.push_back(figure(weights(draw)));
  out.low = out.value + stretch_ * (percentile(drawn, 0.025) - out.value);
  out.high = out.value + stretch_ * (percentile(drawn, 0.975) - out.value);
  return out;
}

}  // namespace stillmap::mapping
