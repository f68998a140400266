#include "trajectory/levelling.hpp"

#include <stillmap/mapping/ground.hpp>
#include <stillmap/maps/ground_plane.hpp>
#include <stillmap/maps/small_matrices.hpp>

#include <cmath>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Ground that the vehicle stands on, before the street bends away [m].
constexpr float kAroundM = 15.0F;
constexpr std::size_t kFewestPoints = 100;
/// A plane steeper against the sensor (50 degrees) is taken for a wall.
constexpr double kSteepestCosine = 0.64;

/// Plane through points by least squares: normal (unit, upward) and its distance below the sensor
/// [m].
struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double below_m = 0.0;
};

Plane plane_of(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) spread += (p - mean) * (p - mean).transpose();
  const maps::SymmetricEigen<3> eigen = maps::eigen_of(spread);
  Plane plane;
  plane.normal = eigen.vectors.col(0);
  if (plane.normal.z() < 0.0) plane.normal = -plane.normal;
  plane.below_m = -plane.normal.dot(mean);
  return plane;
}

/// Ground near the sensor of a scan with z up.
std::vector<Eigen::Vector3d> ground_around(const maps::PointCloud& scan) {
  const GroundResult ground = make_ground_segmenter()->segment(scan);
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    if (ground.is_ground[i] != 0 && scan.positions[i].norm() < kAroundM)
      points.push_back(scan.positions[i].cast<double>());
  }
  return points;
}

}  // namespace

Eigen::Isometry3d T_ground_lidar(const maps::PointCloud& scan_lidar) {
  std::vector<Eigen::Vector3d> points = ground_around(scan_lidar);
  Eigen::Quaterniond R_upright_lidar = Eigen::Quaterniond::Identity();
  if (points.size() < kFewestPoints) {
    const auto stood_over = maps::find_ground_plane(scan_lidar.positions);
    if (!stood_over || std::abs(stood_over->up.z()) < kSteepestCosine)
      return Eigen::Isometry3d::Identity();
    R_upright_lidar = maps::turn_between(stood_over->up, Eigen::Vector3d::UnitZ());
    maps::PointCloud upright = scan_lidar;
    const Eigen::Matrix3f turn = R_upright_lidar.toRotationMatrix().cast<float>();
    for (Eigen::Vector3f& p : upright.positions) p = turn * p;
    points = ground_around(upright);
  }
  if (points.size() < kFewestPoints) return Eigen::Isometry3d::Identity();
  const Plane plane = plane_of(points);
  const Eigen::Vector3d up_lidar = R_upright_lidar.conjugate() * plane.normal;
  Eigen::Matrix3d R_lidar_ground;
  R_lidar_ground.col(2) = up_lidar;
  R_lidar_ground.col(1) = up_lidar.cross(Eigen::Vector3d::UnitX()).normalized();
  R_lidar_ground.col(0) = R_lidar_ground.col(1).cross(R_lidar_ground.col(2));
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R_lidar_ground.transpose();
  T.translation().z() = plane.below_m;
  return T;
}

}  // namespace stillmap::mapping
