#include "evaluation/localization_metrics.hpp"

#include "evaluation/prior_draws.hpp"

#include <stillmap/maps/frames.hpp>

#include <Eigen/Cholesky>

#include <algorithm>
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
constexpr std::size_t kResamplings = 2000;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double degrees(double rad) { return rad * 180.0 / std::numbers::pi; }

/// An answer's error after the bias was taken out.
struct Error {
  double m = 0.0;
  double horizontal_m = 0.0;
  double deg = 0.0;
  double yaw_deg = 0.0;
  double nees = kNaN;
};

Error error_of(const LocalizationRecord& record, const Vector6d& bias) {
  const Vector6d e = maps::log_se3(record.T_reference_answer * maps::exp_se3(bias).inverse());
  Error error;
  error.m = e.head<3>().norm();
  error.horizontal_m = e.head<2>().norm();
  error.deg = degrees(e.tail<3>().norm());
  error.yaw_deg = degrees(std::abs(e[5]));
  const Eigen::LLT<Eigen::Matrix<double, 6, 6>> factor(record.covariance);
  if (factor.info() == Eigen::Success) error.nees = e.dot(factor.solve(e));
  return error;
}

double root_mean_square(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return values.empty() ? kNaN : std::sqrt(sum / static_cast<double>(values.size()));
}

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? kNaN : static_cast<double>(part) / static_cast<double>(whole);
}

/// Percentile interval of the success rate when whole scans are drawn with replacement.
std::array<double, 2> clustered_interval(const std::vector<LocalizationRecord>& records,
                                         const std::vector<char>& success, std::uint64_t seed) {
  std::vector<std::array<double, 2>> scans;
  for (std::size_t i = 0; i < records.size(); ++i) {
    if (records[i].scan >= scans.size()) scans.resize(records[i].scan + 1);
    scans[records[i].scan][0] += success[i];
    scans[records[i].scan][1] += 1.0;
  }
  if (scans.empty()) return {kNaN, kNaN};
  std::vector<double> rates;
  rates.reserve(kResamplings);
  for (std::size_t k = 0; k < kResamplings; ++k) {
    const CounterRandom random(seed, k, scans.size());
    std::array<double, 2> sums{};
    for (std::size_t j = 0; j < scans.size(); ++j) {
      const auto drawn =
          static_cast<std::size_t>(random.uniform(j) * static_cast<double>(scans.size()));
      sums[0] += scans[drawn][0];
      sums[1] += scans[drawn][1];
    }
    rates.push_back(sums[1] > 0.0 ? sums[0] / sums[1] : 0.0);
  }
  return {percentile(rates, 0.025), percentile(rates, 0.975)};
}

void count_status(const LocalizationRecord& record, LocalizationLevel& level) {
  switch (record.status) {
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
  for (const std::string& reason : record.reasons) ++level.reasons[reason];
}

void set_errors(const std::vector<Error>& errors, LocalizationLevel& level) {
  std::vector<double> m, horizontal, deg, yaw, nees;
  for (const Error& error : errors) {
    m.push_back(error.m);
    horizontal.push_back(error.horizontal_m);
    deg.push_back(error.deg);
    yaw.push_back(error.yaw_deg);
    if (!std::isnan(error.nees)) nees.push_back(error.nees);
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
  level.nees_inside_95 = share(inside, nees.size());
}

}  // namespace

double percentile(std::vector<double> values, double q) {
  if (values.empty()) return kNaN;
  std::sort(values.begin(), values.end());
  const double at = q * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

Vector6d bias_of_half(const std::vector<LocalizationRecord>& records, std::size_t half) {
  std::array<std::vector<double>, 6> components;
  for (const LocalizationRecord& record : records) {
    if (record.status == PoseStatus::kLost || record.scan % 2 != half) continue;
    const Vector6d e = maps::log_se3(record.T_reference_answer);
    for (std::size_t k = 0; k < 6; ++k) components[k].push_back(e[static_cast<Eigen::Index>(k)]);
  }
  Vector6d bias = Vector6d::Zero();
  if (components[0].empty()) return bias;
  for (std::size_t k = 0; k < 6; ++k)
    bias[static_cast<Eigen::Index>(k)] = percentile(components[k], 0.5);
  return bias;
}

LocalizationLevel level_of(const std::vector<LocalizationRecord>& records,
                           const PriorError& prior_error, std::uint64_t seed) {
  const std::array<Vector6d, 2> bias_from{bias_of_half(records, 0), bias_of_half(records, 1)};
  LocalizationLevel level;
  level.prior_error = prior_error;
  level.queries = records.size();
  std::vector<Error> errors;
  std::vector<char> success(records.size(), 0);
  std::vector<double> cpu_ms, wall_ms;
  std::size_t false_ok = 0;
  for (std::size_t i = 0; i < records.size(); ++i) {
    const LocalizationRecord& record = records[i];
    count_status(record, level);
    cpu_ms.push_back(record.cpu_ms);
    wall_ms.push_back(record.wall_ms);
    if (record.status == PoseStatus::kLost) continue;
    const Error error = error_of(record, bias_from[1 - record.scan % 2]);
    errors.push_back(error);
    success[i] = error.m <= kSuccessM && error.deg <= kSuccessDeg ? 1 : 0;
    if (record.status == PoseStatus::kOk && !(error.m <= kFalseM && error.deg <= kFalseDeg))
      ++false_ok;
  }
  const auto succeeded = static_cast<std::size_t>(std::count(success.begin(), success.end(), 1));
  level.success_rate = share(succeeded, records.size());
  level.success_interval = clustered_interval(records, success, seed);
  level.false_ok_rate = share(false_ok, records.size());
  set_errors(errors, level);
  level.cpu_ms = {percentile(cpu_ms, 0.5), percentile(cpu_ms, 0.95)};
  level.wall_ms = {percentile(wall_ms, 0.5), percentile(wall_ms, 0.95)};
  return level;
}

}  // namespace stillmap::mapping
