#include "judge.hpp"

#include <stillmap/localization/adjoint.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::localization {
namespace {

/// Deviations from zero that an error may reach once in a thousand; 3.3 if errors were normal, but
/// their tails are heavier.
constexpr double kLevelDeviations = 4.5;

}  // namespace

void judge(const Evidence& evidence, const Matrix6d& covariance, const VerdictOptions& options,
           AlignmentResult& result) {
  const Support& support = evidence.support;
  result.inlier_ratio = support.inlier_ratio;
  result.rmse_m = support.rmse_m;
  result.degenerate_directions = evidence.observability.degenerate;
  result.covariance = covariance;
  const bool little_structure =
      support.known_standing < static_cast<std::size_t>(options.min_standing_points);
  if (!little_structure && support.standing_ratio < options.lost_support) {
    result.status = PoseStatus::kLost;
    result.reasons = {Reason::kLowInlierRatio};
    return;
  }
  if (little_structure) result.reasons.push_back(Reason::kTooLittleStructure);
  if (!little_structure && support.standing_ratio < options.ok_support) {
    result.reasons.push_back(Reason::kLowInlierRatio);
  }
  if (support.known_ratio < options.min_known_share)
    result.reasons.push_back(Reason::kLittleOverlap);
  if (!result.degenerate_directions.empty())
    result.reasons.push_back(Reason::kUnobservableDirection);
  if (evidence.ambiguous) result.reasons.push_back(Reason::kAmbiguous);
  if (evidence.contradicts_prior) result.reasons.push_back(Reason::kContradictsPrior);
  if (evidence.not_deskewed) result.reasons.push_back(Reason::kNotDeskewed);
  const double worst_m = std::sqrt(covariance.diagonal().head<3>().maxCoeff());
  const double worst_rad = std::sqrt(covariance.diagonal().tail<3>().maxCoeff());
  if (!(worst_m < options.max_ok_deviation_m && worst_rad < options.max_ok_deviation_rad)) {
    result.reasons.push_back(Reason::kLargeCovariance);
  }
  result.status = result.reasons.empty() ? PoseStatus::kOk : PoseStatus::kDegraded;
  if (result.status == PoseStatus::kOk) result.protection = protection_levels(covariance);
}

ProtectionLevels protection_levels(const Matrix6d& covariance) {
  const auto level = [&](Eigen::Index axis) {
    const double variance = covariance(axis, axis);
    return variance > 0.0 && std::isfinite(variance) ? kLevelDeviations * std::sqrt(variance)
                                                     : std::numeric_limits<double>::infinity();
  };
  return {level(0), level(1), level(2), level(5)};
}

ProtectionLevels protection_levels_in_base(const AlignmentResult& result,
                                           const Eigen::Isometry3d& T_base_lidar) {
  const ProtectionLevels& own = result.protection;
  const bool bounded = std::isfinite(own.longitudinal_m) && std::isfinite(own.lateral_m) &&
                       std::isfinite(own.vertical_m) && std::isfinite(own.yaw_rad);
  if (!bounded) return {};
  const Matrix6d carry = adjoint(T_base_lidar);
  return protection_levels(carry * result.covariance * carry.transpose());
}

}  // namespace stillmap::localization
