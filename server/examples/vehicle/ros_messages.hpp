#pragma once

#include <Eigen/Geometry>

#include <cstring>
#include <string>

#include "vehicle_localizer.hpp"

/// Fills and reads messages whose fields have the same names in ROS 1 and 2; the types are the
/// node's.
namespace stillmap::vehicle {

/// geometry_msgs/Pose -> a motion. @return nothing for a quaternion that is none.
template <typename Pose>
std::optional<Eigen::Isometry3d> motion_of(const Pose& pose) {
  const Eigen::Quaterniond q(pose.orientation.w, pose.orientation.x, pose.orientation.y,
                             pose.orientation.z);
  constexpr double kTolerance = 1e-2;
  if (!(std::abs(q.norm() - 1.0) < kTolerance)) return std::nullopt;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = q.normalized().toRotationMatrix();
  T.translation() = Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  return T;
}

/// geometry_msgs/Transform -> a motion.
template <typename Transform>
Eigen::Isometry3d motion_of_transform(const Transform& transform) {
  const auto& t = transform.translation;
  const auto& q = transform.rotation;
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).normalized().toRotationMatrix();
  T.translation() = Eigen::Vector3d(t.x, t.y, t.z);
  return T;
}

template <typename Vector, typename Quaternion>
void fill(Vector& vector, Quaternion& quaternion, const Eigen::Isometry3d& T) {
  const Eigen::Quaterniond q(T.linear());
  vector.x = T.translation().x();
  vector.y = T.translation().y();
  vector.z = T.translation().z();
  quaternion.w = q.w();
  quaternion.x = q.x();
  quaternion.y = q.y();
  quaternion.z = q.z();
}

/// geometry_msgs/PoseWithCovariance.
template <typename PoseWithCovariance>
void fill(PoseWithCovariance& message, const Estimate& estimate) {
  fill(message.pose.position, message.pose.orientation, estimate.T_map_base);
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column < 6; ++column)
      message.covariance[static_cast<std::size_t>(6 * row + column)] =
          estimate.covariance(row, column);
}

template <typename Covariance>
Matrix6d matrix_of(const Covariance& covariance) {
  return Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(covariance.data());
}

/// geometry_msgs/Transform: where the points' frame stands in the map frame.
template <typename Transform>
void fill_frame(Transform& transform, const MapPoints& points) {
  Eigen::Isometry3d T_map_points = Eigen::Isometry3d::Identity();
  T_map_points.translation() = points.origin_map;
  fill(transform.translation, transform.rotation, T_map_points);
}

/// sensor_msgs/PointCloud2 without its header.
template <typename Cloud>
void fill(Cloud& cloud, const MapPoints& map_points) {
  const auto& points = map_points.points;
  const char* const names[] = {"x", "y", "z", "intensity"};
  constexpr std::uint8_t kFloat32 = 7;
  cloud.fields.resize(std::size(names));
  for (std::size_t i = 0; i < std::size(names); ++i) {
    cloud.fields[i].name = names[i];
    cloud.fields[i].offset = static_cast<std::uint32_t>(i * sizeof(float));
    cloud.fields[i].datatype = kFloat32;
    cloud.fields[i].count = 1;
  }
  cloud.height = 1;
  cloud.width = static_cast<std::uint32_t>(points.size());
  cloud.point_step = sizeof(points[0]);
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.is_dense = true;
  cloud.data.resize(points.size() * sizeof(points[0]));
  if (!points.empty()) std::memcpy(cloud.data.data(), points.data(), cloud.data.size());
}

/// diagnostic_msgs/DiagnosticStatus; its levels are 0 OK, 1 WARN, 2 ERROR.
template <typename Status>
void fill(Status& status, const Health& health, const std::string& label) {
  status.level = static_cast<std::uint8_t>(health.level);
  status.name = "stillmap: localization";
  status.message = health.message;
  status.hardware_id = label;
  status.values.resize(health.values.size());
  for (std::size_t i = 0; i < health.values.size(); ++i) {
    status.values[i].key = health.values[i].first;
    status.values[i].value = health.values[i].second;
  }
}

}  // namespace stillmap::vehicle
