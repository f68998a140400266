#include "uncertainty.hpp"

#include "clustered_sums.hpp"

#include <stillmap/maps/frames.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <span>

namespace stillmap::localization {
namespace {

/// How far a pose is moved to see whether the scan notices [m]: beyond the noise, past a post.
constexpr double kProbeM = 1.0;
constexpr float kProbeKernelM = 0.3F;
/// A turn moves points at this many median ranges by `kProbeM`, at most those at `kLeverM`: within
/// the walls of a room a turn over 15 m is less than the noise.
constexpr float kLeverRanges = 1.5F;
constexpr std::size_t kProbeStride = 2;

constexpr double kUnknownM = 10.0;
/// Share of the shift between near points and all alike that the error is.
constexpr double kBendShareOfError = 0.2;
/// Shared by all points of a scan: map registration, voxels that see a surface from one side,
/// deskewing.
const Vector6d kFloor = (Vector6d() << 1e-3, 1e-3, 2e-3, 5e-5, 5e-5, 8e-5).finished();

/// Costs of some of the points at a pose, each in [0, 1]. The points are probed by number.
class Probe {
 public:
  Probe(const MapIndex::Level& level, const Query& query)
      : level_(level),
        query_(query),
        size_((query.points.size() + kProbeStride - 1) / kProbeStride) {}

  [[nodiscard]] std::size_t size() const { return size_; }
  /// Of the points `first` to `first + costs.size() - 1`.
  void cost(std::size_t first, const Eigen::Isometry3d& T_index_lidar,
            std::span<float> costs) const {
    constexpr float kKernel2 = kProbeKernelM * kProbeKernelM;
    const Eigen::Isometry3f T = T_index_lidar.cast<float>();
    std::fill(costs.begin(), costs.end(), 1.0F);
    level_.for_each_nearest(
        costs.size(), kernel_variance_m2(kProbeKernelM),
        [&](std::size_t i) -> Eigen::Vector3f {
          return T * query_.points[(first + i) * kProbeStride];
        },
        [&](std::size_t i, const Eigen::Vector3f& p, const MapIndex::Level::Nearest& nearest) {
          if (sharp_match(nearest, p, kProbeKernelM) == nullptr) return;
          const float distance2_m2 = across2_m2(nearest, p);
          costs[i] = distance2_m2 / (kKernel2 + distance2_m2);
        });
  }

 private:
  const MapIndex::Level& level_;
  const Query& query_;
  std::size_t size_;
};

/// Over what a turn is probed [m].
double probe_lever_m(const Query& query) {
  std::vector<float> ranges(query.points.size());
  std::transform(query.points.begin(), query.points.end(), ranges.begin(),
                 [](const Eigen::Vector3f& p) { return p.norm(); });
  const auto middle = ranges.begin() + static_cast<std::ptrdiff_t>(ranges.size() / 2);
  std::nth_element(ranges.begin(), middle, ranges.end());
  return std::min(kLeverM, static_cast<double>(kLeverRanges * *middle));
}

Matrix6d unknown_covariance() {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(kUnknownM * kUnknownM),
      Eigen::Vector3d::Constant(kUnknownM * kUnknownM / (kLeverM * kLeverM));
  return variances.asDiagonal();
}

}  // namespace

bool rise(const std::vector<float>& here, const CostsThere& cost_there) {
  constexpr std::size_t kAtOnce = 256;
  std::array<float, kAtOnce> there;
  double sum = 0.0;
  double squares = 0.0;
  // No cost falls by more than what it is here, nor changes by more than 1.
  double most_fall = std::accumulate(here.begin(), here.end(), 0.0);
  for (std::size_t first = 0; first < here.size(); first += kAtOnce) {
    const std::span<float> costs = std::span(there).first(std::min(kAtOnce, here.size() - first));
    cost_there(first, costs);
    for (std::size_t i = 0; i < costs.size(); ++i) {
      const float from = here[first + i];
      const auto difference = static_cast<double>(costs[i] - from);
      sum += difference;
      squares += difference * difference;
      most_fall -= static_cast<double>(from);
    }
    const auto left = static_cast<double>(here.size() - first - costs.size());
    if (left > 0.0 && sum - most_fall > kMinProbeScore * std::sqrt(squares + left)) return true;
  }
  return squares > 0.0 && sum / std::sqrt(squares) > kMinProbeScore;
}

Observability observability_of(const MapIndex::Level& level, const Query& query,
                               const Eigen::Isometry3d& T_index_lidar, const Matrix6d& H) {
  const maps::SymmetricEigen<6> eigen = maps::eigen_of(in_metres(H));
  const Probe probe(level, query);
  std::vector<float> here(probe.size());
  probe.cost(0, T_index_lidar, here);
  const auto is_worse = [&](const Vector6d& move) {
    const Eigen::Isometry3d T = T_index_lidar * maps::exp_se3(move);
    return rise(here,
                [&](std::size_t first, std::span<float> costs) { probe.cost(first, T, costs); });
  };
  const double lever_m = probe_lever_m(query);
  Observability out;
  for (Eigen::Index k = 0; k < 6; ++k) {
    const Vector6d direction = eigen.vectors.col(k);
    Vector6d move = kProbeM * direction;
    move.tail<3>() /= lever_m;
    if (!(is_worse(move) && is_worse(-move))) out.degenerate.push_back(direction);
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

}  // namespace stillmap::localization
