#include "noise_information.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include "registration.hpp"

#include <algorithm>
#include <array>

namespace stillmap::localization {
namespace {

Vector6d jacobian_of(const Eigen::Vector3d& axis, const Eigen::Matrix3d& R_lidar_index,
                     const Eigen::Vector3d& p_lidar) {
  const Eigen::Vector3d g = R_lidar_index * axis;
  Vector6d J;
  J << g, p_lidar.cross(g);
  return J;
}

}  // namespace

double tilt_variance(double small_m2, double other_m2, double points) {
  const double gap_m2 = std::max(other_m2 - small_m2, 1e-6);
  return std::min(1.0, small_m2 * other_m2 / (gap_m2 * gap_m2 * points));
}

NoiseInformation noise_information_of(const MapIndex::Level& level, const Query& query,
                                      const Eigen::Isometry3d& T_index_lidar, float kernel_m) {
  const Eigen::Isometry3f T = T_index_lidar.cast<float>();
  const Eigen::Matrix3d R_lidar_index = T_index_lidar.linear().transpose();
  const auto place = [&](std::size_t i) -> Eigen::Vector3f { return T * query.points[i]; };
  NoiseInformation out;
  const auto take = [&](std::size_t i, const Eigen::Vector3f& p,
                        const MapIndex::Level::Nearest& nearest) {
    const Voxel* voxel = sharp_match(nearest, p, kernel_m);
    if (voxel == nullptr) return;
    const Eigen::Vector3d p_lidar = query.points[i].cast<double>();
    const std::array<Eigen::Vector3d, 3> axes = {voxel->axis0.cast<double>(),
                                                 voxel->axis1.cast<double>(),
                                                 voxel->axis0.cross(voxel->axis1).cast<double>()};
    const std::array<double, 3> variances = {static_cast<double>(voxel->variance0),
                                             static_cast<double>(voxel->variance1),
                                             static_cast<double>(voxel->variance2)};
    const Eigen::Vector3d offset = (p - nearest.mean).cast<double>();
    const double residual_m = axes[0].dot(offset);
    const double weight = robust_weight(residual_m * residual_m, static_cast<double>(kernel_m)) /
                          (variances[0] + static_cast<double>(kernel_variance_m2(kernel_m)));
    const Vector6d J = jacobian_of(axes[0], R_lidar_index, p_lidar);
    out.measured += weight * J * J.transpose();
    for (std::size_t other = 1; other < 3; ++other) {
      const double tilt =
          tilt_variance(variances[0], variances[other], static_cast<double>(voxel->points));
      const Vector6d J_other = jacobian_of(axes[other], R_lidar_index, p_lidar);
      out.feigned += weight * tilt * J_other * J_other.transpose();
    }
  };
  level.for_each_nearest(query.points.size(), kernel_variance_m2(kernel_m), place, take);
  return out;
}

std::vector<Vector6d> untold_directions(const NoiseInformation& information) {
  const maps::SymmetricEigen<6> eigen = maps::eigen_of(in_metres(information.measured));
  const Matrix6d feigned = in_metres(information.feigned);
  std::vector<Vector6d> untold;
  for (Eigen::Index k = 0; k < 6; ++k) {
    const Vector6d direction = eigen.vectors.col(k);
    const double by_noise = direction.dot(feigned * direction);
    if (!(eigen.values[k] > kLeastOverNoise * by_noise)) untold.push_back(direction);
  }
  return untold;
}

}  // namespace stillmap::localization
