#include "verdict.hpp"

#include "clustered_sums.hpp"

#include <stillmap/localization/adjoint.hpp>
#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace stillmap::localization {
namespace {

/// Deviation of a point that lies on a surface of the map: noise of the sensor and of the map's
/// poses [m].
constexpr float kSurfaceSigmaM = 0.07F;
constexpr float kMaxSurface2 = 9.0F;

/// How far a pose is moved to see whether the scan notices [m]: beyond the noise, past a post.
constexpr double kProbeM = 1.0;
constexpr float kProbeKernelM = 0.3F;
/// A turn moves points at this many median ranges by `kProbeM`, at most those at `kLeverM`: within
/// the walls of a room a turn over 15 m is less than the noise.
constexpr float kLeverRanges = 1.5F;
/// Deviations by which moving must worsen the fit. In a synthetic corridor the score along it stays
/// within 2, on simulated highways with posts it is 4 to 7, in streets 11 and more.
constexpr double kMinProbeScore = 4.0;
constexpr std::size_t kProbeStride = 2;

constexpr double kUnknownM = 10.0;
/// Share of the shift between near points and all alike that the error is.
constexpr double kBendShareOfError = 0.2;
/// Shared by all points of a scan: map registration, voxels that see a surface from one side,
/// deskewing.
const Vector6d kFloor = (Vector6d() << 1e-3, 1e-3, 2e-3, 5e-5, 5e-5, 8e-5).finished();

constexpr std::size_t kMinStanding = 60;
constexpr double kMinKnownRatio = 0.3;
/// In synthetic streets scans matched 5 to 50 m from their place, or in another street, reach 0.65
/// at most, since the fronts along the street fit wherever one is; at their place 0.95 and more,
/// real scans 0.83 and more. Between the two an answer may be right (much has changed since the
/// map), but nothing proves it.
constexpr double kLostStandingRatio = 0.35;
constexpr double kOkStandingRatio = 0.72;
/// Deviations from zero that an error may reach once in a thousand; 3.3 if errors were normal, but
/// their tails are heavier.
constexpr double kLevelDeviations = 4.5;
constexpr double kMaxOkDeviationM = 0.15;
constexpr double kMaxOkDeviationRad = 0.01;

bool is_known(std::span<const MapIndex::Level> levels, const Eigen::Vector3f& p) {
  return levels.front().nearest(p, 1.0F).voxel != nullptr;
}

/// Costs of some of the points at a pose.
std::vector<float> costs_at(const MapIndex::Level& level, const Query& query,
                            const Eigen::Isometry3d& T_index_lidar) {
  constexpr float kKernel2 = kProbeKernelM * kProbeKernelM;
  const Eigen::Isometry3f T = T_index_lidar.cast<float>();
  std::vector<float> costs((query.points.size() + kProbeStride - 1) / kProbeStride, 1.0F);
  const auto place = [&](std::size_t i) -> Eigen::Vector3f {
    return T * query.points[i * kProbeStride];
  };
  level.for_each_nearest(costs.size(), kernel_variance_m2(kProbeKernelM), place,
                         [&](std::size_t i, const MapIndex::Level::Nearest& nearest) {
                           const Eigen::Vector3f p = place(i);
                           const Voxel* voxel = sharp_match(nearest, p, kProbeKernelM);
                           if (voxel == nullptr) return;
                           const float distance2_m2 = across2_m2(*voxel, p);
                           costs[i] = distance2_m2 / (kKernel2 + distance2_m2);
                         });
  return costs;
}

/// Over what a turn is probed [m].
double probe_lever_m(const Query& query) {
  std::vector<float> ranges(query.points.size());
  std::transform(query.points.begin(), query.points.end(), ranges.begin(),
                 [](const Eigen::Vector3f& p) { return p.norm(); });
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return std::min(kLeverM, static_cast<double>(kLeverRanges * *middle));
}

/// Mean rise from some costs to others, in deviations of that mean.
double rise_score(const std::vector<float>& from, const std::vector<float>& to) {
  double sum = 0.0;
  double squares = 0.0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const auto rise = static_cast<double>(to[i] - from[i]);
    sum += rise;
    squares += rise * rise;
  }
  return squares > 0.0 ? sum / std::sqrt(squares) : 0.0;
}

Matrix6d unknown_covariance() {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(kUnknownM * kUnknownM),
      Eigen::Vector3d::Constant(kUnknownM * kUnknownM / (kLeverM * kLeverM));
  return variances.asDiagonal();
}

}  // namespace

Support support_of(std::span<const MapIndex::Level> levels, const Query& query,
                   const Eigen::Isometry3d& T_index_lidar, std::size_t stride) {
  const Eigen::Isometry3f T = T_index_lidar.cast<float>();
  const MapIndex::Level& fine = levels.back();
  std::size_t inliers = 0, near = 0, standing = 0, known = 0, standing_inliers = 0;
  double squares = 0.0;
  const auto place = [&](std::size_t i) -> Eigen::Vector3f { return T * query.points[i * stride]; };
  const auto count = [&](std::size_t i, const MapIndex::Level::Nearest& nearest) {
    const Eigen::Vector3f p = place(i);
    const bool inlier = nearest.voxel != nullptr && nearest.distance2 < kMaxSurface2;
    if (nearest.voxel != nullptr) ++near;
    if (inlier) {
      ++inliers;
      const double across = static_cast<double>(nearest.voxel->axis0.dot(p - nearest.voxel->mean));
      squares += across * across;
    }
    if (query.stands[i * stride] == 0) return;
    ++standing;
    if (inlier) ++standing_inliers;
    if (inlier || is_known(levels, p)) ++known;
  };
  const std::size_t seen = (query.points.size() + stride - 1) / stride;
  fine.for_each_nearest(seen, kSurfaceSigmaM * kSurfaceSigmaM, place, count);
  const auto share = [](std::size_t part, std::size_t whole) {
    return whole == 0 ? 0.0 : static_cast<double>(part) / static_cast<double>(whole);
  };
  Support support;
  support.inlier_ratio = share(inliers, seen);
  support.known_inlier_ratio = share(inliers, near);
  support.rmse_m = inliers == 0 ? 0.0 : std::sqrt(squares / static_cast<double>(inliers));
  support.known_standing = known * stride;
  support.known_ratio = share(known, standing);
  support.standing_ratio = share(standing_inliers, known);
  return support;
}

Observability observability_of(const MapIndex::Level& level, const Query& query,
                               const Eigen::Isometry3d& T_index_lidar, const Matrix6d& H) {
  const maps::SymmetricEigen<6> eigen = maps::eigen_of(in_metres(H));
  const std::vector<float> here = costs_at(level, query, T_index_lidar);
  const auto score_of = [&](const Vector6d& move) {
    return rise_score(here, costs_at(level, query, T_index_lidar * maps::exp_se3(move)));
  };
  const double lever_m = probe_lever_m(query);
  Observability out;
  for (Eigen::Index k = 0; k < 6; ++k) {
    const Vector6d direction = eigen.vectors.col(k);
    Vector6d move = kProbeM * direction;
    move.tail<3>() /= lever_m;
    const double score = std::min(score_of(move), score_of(-move));
    if (!(score > kMinProbeScore)) out.degenerate.push_back(direction);
    // Eigenvalues ascend: once three directions in a row hold, the stronger ones do.
    if (k >= 2 && out.degenerate.empty()) break;
  }
  return out;
}

Matrix6d covariance_of(const ResidualRows& rows, const Eigen::Isometry3d& T_index_lidar,
                       float kernel_m, const Vector6d& bend,
                       const std::vector<Vector6d>& degenerate) {
  ClusteredSums<6> sums(static_cast<double>(kernel_m));
  for (std::size_t i = 0; i < rows.count; ++i) {
    const Eigen::Vector3d point(rows.point_x[i], rows.point_y[i], rows.point_z[i]);
    const auto [residual_m, J] = axis_residual(rows, i, T_index_lidar);
    sums.add(T_index_lidar * point, residual_m, static_cast<double>(rows.variance_m2[i]), J);
  }
  if (!sums.any()) return unknown_covariance();
  Matrix6d covariance = sums.covariance(kUnitsOfPose);
  for (const Vector6d& direction : degenerate) {
    covariance += kUnknownM * kUnknownM * direction * direction.transpose();
  }
  covariance = out_of_metres(covariance);
  const Vector6d share = kBendShareOfError * bend;
  covariance += share * share.transpose();
  covariance.diagonal() += kFloor.cwiseAbs2();
  return 0.5 * (covariance + covariance.transpose());
}

void judge(const Evidence& evidence, const Matrix6d& covariance, AlignmentResult& result) {
  const Support& support = evidence.support;
  result.inlier_ratio = support.inlier_ratio;
  result.rmse_m = support.rmse_m;
  result.degenerate_directions = evidence.observability.degenerate;
  result.covariance = covariance;
  const bool little_structure = support.known_standing < kMinStanding;
  if (!little_structure && support.standing_ratio < kLostStandingRatio) {
    result.status = PoseStatus::kLost;
    result.reasons = {"low_inlier_ratio"};
    return;
  }
  if (little_structure) result.reasons.emplace_back("too_little_structure");
  if (!little_structure && support.standing_ratio < kOkStandingRatio) {
    result.reasons.emplace_back("low_inlier_ratio");
  }
  if (support.known_ratio < kMinKnownRatio) result.reasons.emplace_back("little_overlap");
  if (!result.degenerate_directions.empty()) result.reasons.emplace_back("unobservable_direction");
  if (evidence.ambiguous) result.reasons.emplace_back("ambiguous");
  if (evidence.contradicts_prior) result.reasons.emplace_back("contradicts_prior");
  if (evidence.not_deskewed) result.reasons.emplace_back("not_deskewed");
  const double worst_m = std::sqrt(covariance.diagonal().head<3>().maxCoeff());
  const double worst_rad = std::sqrt(covariance.diagonal().tail<3>().maxCoeff());
  if (!(worst_m < kMaxOkDeviationM && worst_rad < kMaxOkDeviationRad)) {
    result.reasons.emplace_back("large_covariance");
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
