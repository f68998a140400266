#include "evaluation/localization/localization_metrics.hpp"

#include "core/share_of.hpp"
#include "evaluation/localization/integrity.hpp"
#include "evaluation/localization/resampling.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

namespace stillmap::mapping {
namespace {

using localization::PoseStatus;

constexpr double kSuccessM = 0.2;
constexpr double kSuccessDeg = 1.0;
constexpr double kFalseM = 0.5;
constexpr double kFalseDeg = 2.0;
/// 95 % point of chi-squared with 6 degrees of freedom.
constexpr double kChiSquared95 = 12.592;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

bool is_lost(const LocalizationQuery& query) { return query.status == PoseStatus::kLost; }

double off_m(const LocalizationQuery& query) { return query.error.head<3>().norm(); }
double off_deg(const LocalizationQuery& query) { return degrees(query.error.tail<3>().norm()); }
bool is_within(const LocalizationQuery& query, double metres, double degrees) {
  return off_m(query) <= metres && off_deg(query) <= degrees;
}

double nees_of(const Vector6d& error, const Eigen::Matrix<double, 6, 6>& covariance) {
  return maps::mahalanobis_squared(error, covariance).value_or(kNaN);
}

double root_mean_square(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return values.empty() ? kNaN : std::sqrt(sum / static_cast<double>(values.size()));
}

void count_status(const LocalizationQuery& query, LocalizationLevel& level) {
  switch (query.status) {
    case PoseStatus::kOk:
      ++level.ok;
      break;
    case PoseStatus::kDegraded:
      ++level.degraded;
      break;
    case PoseStatus::kLost:
      ++level.lost;
      break;
  }
  for (const localization::Reason reason : query.reasons) ++level.reasons[reason];
}

void set_errors(const std::vector<LocalizationQuery>& queries, LocalizationLevel& level) {
  std::vector<double> m, horizontal, deg, yaw, nees;
  for (const LocalizationQuery& query : queries) {
    if (is_lost(query)) continue;
    m.push_back(off_m(query));
    horizontal.push_back(query.error.head<2>().norm());
    deg.push_back(off_deg(query));
    yaw.push_back(degrees(query.error[5]));
    if (!std::isnan(query.nees)) nees.push_back(query.nees);
  }
  level.translation_m = {percentile(m, 0.5), percentile(m, 0.95), root_mean_square(horizontal)};
  level.rotation_deg = {percentile(deg, 0.5), percentile(deg, 0.95), root_mean_square(yaw)};
  double sum = 0.0;
  std::size_t inside = 0;
  for (const double value : nees) {
    sum += value;
    if (value < kChiSquared95) ++inside;
  }
  level.nees_mean = nees.empty() ? kNaN : sum / static_cast<double>(nees.size());
  level.nees_inside_95 = share_of(inside, nees.size());
}

}  // namespace

bool is_success(const LocalizationQuery& query) {
  return !is_lost(query) && is_within(query, kSuccessM, kSuccessDeg);
}

double percentile(std::vector<double> values, double q) {
  if (values.empty()) return kNaN;
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  const double fraction = at - static_cast<double>(below);
  // Infinite values differ by NaN.
  if (fraction == 0.0 || values[below] == values[above]) return values[below];
  return values[below] + fraction * (values[above] - values[below]);
}

Vector6d bias_of_half(const std::vector<LocalizationRecord>& records, std::size_t half) {
  std::array<std::vector<double>, 6> components;
  for (const LocalizationRecord& record : records) {
    if (is_lost(record.query) || record.position % 2 != half) continue;
    const Vector6d e = maps::log_se3(record.T_reference_answer);
    for (std::size_t k = 0; k < 6; ++k) components[k].push_back(e[static_cast<Eigen::Index>(k)]);
  }
  Vector6d bias = Vector6d::Zero();
  if (components[0].empty()) return bias;
  for (std::size_t k = 0; k < 6; ++k)
    bias[static_cast<Eigen::Index>(k)] = percentile(components[k], 0.5);
  return bias;
}

std::vector<LocalizationQuery> judged(const std::vector<LocalizationRecord>& records,
                                      BiasCorrection correction) {
  std::array<Vector6d, 2> bias_from{Vector6d::Zero(), Vector6d::Zero()};
  if (correction == BiasCorrection::kFit)
    bias_from = {bias_of_half(records, 0), bias_of_half(records, 1)};
  std::vector<LocalizationQuery> queries;
  queries.reserve(records.size());
  for (const LocalizationRecord& record : records) {
    LocalizationQuery& query = queries.emplace_back(record.query);
    if (is_lost(query)) continue;
    const Vector6d& bias = bias_from[1 - record.position % 2];
    // The bias stands between reference and truth, the error on the right of both.
    query.error = maps::log_se3(maps::exp_se3(bias).inverse() * record.T_reference_answer);
    query.nees = nees_of(query.error, record.covariance);
  }
  return queries;
}

LocalizationLevel level_of(const std::vector<LocalizationQuery>& queries,
                           const PriorError& prior_error, std::uint64_t seed) {
  LocalizationLevel level;
  level.prior_error = prior_error;
  level.queries = queries.size();
  std::vector<double> cpu_ms, wall_ms;
  std::size_t successes = 0;
  std::size_t false_ok = 0;
  for (const LocalizationQuery& query : queries) {
    count_status(query, level);
    cpu_ms.push_back(query.cpu_ms);
    wall_ms.push_back(query.wall_ms);
    if (is_success(query)) ++successes;
    if (query.status == PoseStatus::kOk && !is_within(query, kFalseM, kFalseDeg)) ++false_ok;
  }
  const std::vector<ScanCount> success =
      counts_by_scan(queries, is_success, [](const LocalizationQuery&) { return true; });
  const std::vector<double> rates = resampled_rates(success, seed);
  level.success_rate = share_of(successes, queries.size());
  level.success_interval = {percentile(rates, 0.025), percentile(rates, 0.975)};
  level.false_ok_rate = share_of(false_ok, queries.size());
  set_errors(queries, level);
  level.integrity = integrity_of(queries, seed);
  level.cpu_ms = {percentile(cpu_ms, 0.5), percentile(cpu_ms, 0.95)};
  level.wall_ms = {percentile(wall_ms, 0.5), percentile(wall_ms, 0.95)};
  return level;
}

}  // namespace stillmap::mapping
