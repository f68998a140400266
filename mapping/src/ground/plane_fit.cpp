#include "ground/plane_fit.hpp"

#include <stillmap/maps/small_matrices.hpp>

namespace stillmap::mapping {
namespace {

/// Spread of points across their line [m^2] below which the tilt across it is open: 5 cm, some
/// times what sensors and rough ground spread the points of a ring by.
constexpr double kLineVariance = 0.0025;

}  // namespace

PlaneFit PlaneSums::fit() const {
  PlaneFit plane;
  plane.points = points_;
  const double n = points_;
  plane.mean = sum_ / n;
  Eigen::Matrix3d covariance;
  covariance << xx_, xy_, xz_, xy_, yy_, yz_, xz_, yz_, zz_;
  covariance = covariance / n - plane.mean * plane.mean.transpose();
  const maps::SymmetricEigen<3> eigen = maps::eigen_directly_of(covariance);
  plane.variances = eigen.values.reverse().cwiseMax(0.0);
  plane.normal = eigen.vectors.col(0);
  if (plane.variances[1] < kLineVariance) {
    const Eigen::Vector3d line = eigen.vectors.col(2);
    const Eigen::Vector3d level = Eigen::Vector3d::UnitZ() - line.z() * line;
    if (level.norm() > 1e-6) plane.normal = level.normalized();
  }
  if (plane.normal.z() < 0.0) plane.normal = -plane.normal;
  plane.flatness = plane.normal.dot(covariance * plane.normal);
  return plane;
}

}  // namespace stillmap::mapping
