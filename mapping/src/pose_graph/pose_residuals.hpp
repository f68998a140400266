#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace stillmap::mapping {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A node as the solver moves it: R exp(d_rotation), t + R d_translation, d in the order of the
/// covariances (tx ty tz rx ry rz).
struct NodePose {
  Eigen::Quaterniond q_map_node = Eigen::Quaterniond::Identity();
  Eigen::Vector3d t_map_node = Eigen::Vector3d::Zero();

  [[nodiscard]] NodePose moved(const Vector6d& step) const;
  /// The step from here to another pose, rotation angle in [0, pi].
  [[nodiscard]] Vector6d step_to(const NodePose& other) const;
};

[[nodiscard]] NodePose node_pose(const Eigen::Isometry3d& T_map_node);
[[nodiscard]] Eigen::Isometry3d isometry(const NodePose& node);

/// What a measurement says of two nodes, and how its residual changes with their steps.
struct RelativeResidual {
  Vector6d value;
  Matrix6d J_from;
  Matrix6d J_to;
};
struct AbsoluteResidual {
  Vector6d value;
  Matrix6d J;
};
struct PositionResidual {
  Eigen::Vector3d value;
  Eigen::Matrix<double, 3, 6> J;
};

/// The error x of the measured motion: T_from_to_measured x = T_map_from^-1 T_map_to, as step of a
/// node. To first order the x of T exp(x), in which covariances are told; the coupling of SE(3) is
/// left out, which no small error sees.
[[nodiscard]] RelativeResidual relative_residual(const NodePose& from, const NodePose& to,
                                                 const NodePose& T_from_to_measured);
/// The same of a pose in the map.
[[nodiscard]] AbsoluteResidual absolute_residual(const NodePose& node, const NodePose& measured);
/// Where the point `lever_node` is, less where it was measured [m], in the map frame.
[[nodiscard]] PositionResidual position_residual(const NodePose& node,
                                                 const Eigen::Vector3d& position_map_m,
                                                 const Eigen::Vector3d& lever_node_m);

}  // namespace stillmap::mapping
