#include "trajectory/levelling.hpp"

#include <stillmap/mapping/ground.hpp>

#include <Eigen/Eigenvalues>

#include <cmath>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Ground that the vehicle stands on, before the street bends away [m].
constexpr float kAroundM = 15.0F;
constexpr std::size_t kFewestPoints = 100;

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
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(spread);
  Plane plane;
  plane.normal = solver.eigenvectors().col(0);
  if (plane.normal.z() < 0.0) plane.normal = -plane.normal;
  plane.below_m = -plane.normal.dot(mean);
  return plane;
}

}  // namespace

Eigen::Isometry3d T_ground_lidar(const maps::PointCloud& scan_lidar) {
  const GroundResult ground = make_ground_segmenter()->segment(scan_lidar);
  std::vector<Eigen::Vector3d> points;
  for (std::size_t i = 0; i < scan_lidar.size(); ++i) {
    if (ground.is_ground[i] != 0 && scan_lidar.positions[i].norm() < kAroundM)
      points.push_back(scan_lidar.positions[i].cast<double>());
  }
  if (points.size() < kFewestPoints) return Eigen::Isometry3d::Identity();
  const Plane plane = plane_of(points);
  Eigen::Matrix3d R_lidar_ground;
  R_lidar_ground.col(2) = plane.normal;
  R_lidar_ground.col(1) = plane.normal.cross(Eigen::Vector3d::UnitX()).normalized();
  R_lidar_ground.col(0) = R_lidar_ground.col(1).cross(R_lidar_ground.col(2));
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = R_lidar_ground.transpose();
  T.translation().z() = plane.below_m;
  return T;
}

}  // namespace stillmap::mapping
