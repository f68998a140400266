#include "voxel_moments.hpp"

#include <stillmap/maps/small_matrices.hpp>

#include <algorithm>
#include <cmath>

namespace stillmap::localization {
namespace {

/// An axis is sharp when its variance is below this share of the next axis' and of a full cell's
/// (edge^2 / 12): a plane's thickness, a pole's width. A map whose poses wander has walls of 10 cm,
/// and these must still count (their own variance weighs them); foliage and the in-plane axes of a
/// surface must not.
constexpr double kSharpShare = 0.35;
/// A line of points is a pole only when it stands: cos 25 deg. A lying line is usually one ring of
/// the sensor, whose second sharp axis comes from the sampling and would pull towards the map's own
/// rings.
constexpr double kUprightCosine = 0.9;

std::int32_t sharp_axes_of(const Eigen::Vector3d& variances, const Eigen::Matrix3d& axes,
                           double edge_m) {
  const double full_m2 = edge_m * edge_m / 12.0;
  const auto sharp = [&](int axis) {
    return variances[axis] < kSharpShare * std::min(variances[axis + 1], full_m2);
  };
  if (sharp(1)) return std::abs(axes(2, 2)) > kUprightCosine ? 2 : 0;
  return sharp(0) ? 1 : 0;
}

}  // namespace

Voxel voxel_of(const Moments& moments, double edge_m, const Eigen::Vector3d& corner) {
  const double n = moments.count;
  const Eigen::Vector3d mean = moments.sum / moments.weight;
  const Eigen::Matrix3d covariance =
      (moments.outer / moments.weight - mean * mean.transpose()) * (n / (n - 1.0));
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(covariance);
  const Eigen::Vector3d variances = eigen.values.cwiseMax(0.0);
  const Eigen::Matrix3d& axes = eigen.vectors;
  Voxel voxel{};
  voxel.mean = (mean - corner).cast<float>();
  voxel.axis0 = axes.col(0).cast<float>();
  voxel.axis1 = axes.col(1).cast<float>();
  voxel.variance0 = static_cast<float>(variances[0]);
  voxel.variance1 = static_cast<float>(variances[1]);
  voxel.variance2 = static_cast<float>(variances[2]);
  voxel.sharp_axes = sharp_axes_of(variances, axes, edge_m);
  voxel.points = moments.count;
  return voxel;
}

MomentGrid coarser(const MomentGrid& fine) {
  MomentGrid coarse;
  for (const Moments& cell : fine.cells) {
    const auto [x, y, z] = cell_of_key(cell.key);
    coarse.at(cell_key(x >> 1, y >> 1, z >> 1)).add(cell);
  }
  return coarse;
}

}  // namespace stillmap::localization
