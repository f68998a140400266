#include "pose_graph/pose_residuals.hpp"

#include <cmath>

namespace stillmap::mapping {
namespace {

Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v) {
  Eigen::Matrix3d out;
  out << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return out;
}

Eigen::Quaterniond rotation_exp(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  // sin(a / 2) / a; the series' next term is below the last bit there.
  const double scale = angle > 1e-4 ? std::sin(0.5 * angle) / angle : 0.5 - angle * angle / 48.0;
  Eigen::Quaterniond out;
  out.vec() = scale * rotation;
  out.w() = std::cos(0.5 * angle);
  return out;
}

/// Angle in [0, pi]; exact for small ones too, where the arc cosine is not.
Eigen::Vector3d rotation_log(const Eigen::Quaterniond& q) {
  const double sine = q.vec().norm();
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  if (sine < 1e-12) return 2.0 * sign * q.vec();
  return (2.0 * std::atan2(sine, std::abs(q.w())) * sign / sine) * q.vec();
}

/// d log(exp(r) exp(d)) / d d at zero: Sola, Deray, Atchuthan, "A micro Lie theory for state
/// estimation in robotics", 2018, eq. (144).
Eigen::Matrix3d inverse_right_jacobian(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  const Eigen::Matrix3d W = cross_matrix(rotation);
  // (1 - (a / 2) cot(a / 2)) / a^2, which is finite up to pi.
  const double c = angle > 1e-3 ? (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / (angle * angle)
                                : 1.0 / 12.0 + angle * angle / 720.0;
  return Eigen::Matrix3d::Identity() + 0.5 * W + c * W * W;
}

}  // namespace

NodePose NodePose::moved(const Vector6d& step) const {
  return {(q_map_node * rotation_exp(step.tail<3>())).normalized(),
          t_map_node + q_map_node * step.head<3>()};
}

Vector6d NodePose::step_to(const NodePose& other) const {
  const Eigen::Quaterniond q_node_map = q_map_node.conjugate();
  Vector6d out;
  out << q_node_map * (other.t_map_node - t_map_node), rotation_log(q_node_map * other.q_map_node);
  return out;
}

NodePose node_pose(const Eigen::Isometry3d& T_map_node) {
  return {Eigen::Quaterniond(T_map_node.linear()).normalized(), T_map_node.translation()};
}

Eigen::Isometry3d isometry(const NodePose& node) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = node.q_map_node.toRotationMatrix();
  out.translation() = node.t_map_node;
  return out;
}

RelativeResidual relative_residual(const NodePose& from, const NodePose& to,
                                   const NodePose& T_from_to_measured) {
  const Eigen::Quaterniond q_from_map = from.q_map_node.conjugate();
  const NodePose T_from_to{q_from_map * to.q_map_node,
                           q_from_map * (to.t_map_node - from.t_map_node)};
  RelativeResidual out;
  out.value = T_from_to_measured.step_to(T_from_to);
  const Eigen::Matrix3d R_measured_from =
      T_from_to_measured.q_map_node.conjugate().toRotationMatrix();
  const Eigen::Matrix3d R_from_to = T_from_to.q_map_node.toRotationMatrix();
  const Eigen::Matrix3d log_slope = inverse_right_jacobian(out.value.tail<3>());
  out.J_from << -R_measured_from, R_measured_from * cross_matrix(T_from_to.t_map_node),
      Eigen::Matrix3d::Zero(), -log_slope * R_from_to.transpose();
  out.J_to << R_measured_from * R_from_to, Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero(),
      log_slope;
  return out;
}

AbsoluteResidual absolute_residual(const NodePose& node, const NodePose& measured) {
  AbsoluteResidual out;
  out.value = measured.step_to(node);
  out.J << (measured.q_map_node.conjugate() * node.q_map_node).toRotationMatrix(),
      Eigen::Matrix3d::Zero(), Eigen::Matrix3d::Zero(), inverse_right_jacobian(out.value.tail<3>());
  return out;
}

PositionResidual position_residual(const NodePose& node, const Eigen::Vector3d& position_map_m,
                                   const Eigen::Vector3d& lever_node_m) {
  const Eigen::Matrix3d R_map_node = node.q_map_node.toRotationMatrix();
  PositionResidual out;
  out.value = node.t_map_node + R_map_node * lever_node_m - position_map_m;
  out.J << R_map_node, -R_map_node * cross_matrix(lever_node_m);
  return out;
}

}  // namespace stillmap::mapping
