#include "odometry/loam/sweep_motion.hpp"

#include <cmath>

namespace stillmap::mapping::loam {
namespace {

/// Below this angle [rad] the series says as much as the quotient, without 0 / 0.
constexpr double kSmallAngle = 1e-4;

/// d(R(theta) X) = R(theta) d(theta') x X with theta' = J_r(theta) theta (right Jacobian of SO(3)).
Eigen::Matrix3d right_jacobian(const Eigen::Vector3d& theta) {
  const double a = theta.norm();
  const Eigen::Matrix3d K = hat(theta);
  const double first = a < kSmallAngle ? 0.5 - a * a / 24.0 : (1.0 - std::cos(a)) / (a * a);
  const double second =
      a < kSmallAngle ? 1.0 / 6.0 - a * a / 120.0 : (a - std::sin(a)) / (a * a * a);
  return Eigen::Matrix3d::Identity() - first * K + second * K * K;
}

}  // namespace

Eigen::Matrix3d hat(const Eigen::Vector3d& v) {
  Eigen::Matrix3d K;
  K << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return K;
}

Eigen::Matrix3d rotation(const Eigen::Vector3d& theta) {
  const double a = theta.norm();  // eq. (7)
  const Eigen::Matrix3d K = hat(theta);
  if (a < kSmallAngle) return Eigen::Matrix3d::Identity() + K + 0.5 * K * K;
  // Eq. (6) with omega of eq. (8), hat(omega) = K / a.
  return Eigen::Matrix3d::Identity() + (std::sin(a) / a) * K +
         ((1.0 - std::cos(a)) / (a * a)) * K * K;
}

void PartOfMotion::set(const Share& share) {
  share_ = share;
  const Eigen::Vector3d theta = share.turn * T_.tail<3>();
  R_ = rotation(theta);
  t_ = share.way * T_.head<3>();
  turn_ = share.turn * right_jacobian(theta);
}

Eigen::Matrix<double, 3, 6> PartOfMotion::jacobian(const Eigen::Vector3d& X) const {
  Eigen::Matrix<double, 3, 6> J;
  J.leftCols<3>() = share_.way * Eigen::Matrix3d::Identity();
  J.rightCols<3>() = -R_ * hat(X) * turn_;
  return J;
}

Eigen::Isometry3d isometry(const Motion& T) {
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = rotation(T.tail<3>());
  out.translation() = T.head<3>();
  return out;
}

Motion motion(const Eigen::Isometry3d& T_before_now) {
  const Eigen::AngleAxisd turn(T_before_now.linear());
  Motion T;
  T << T_before_now.translation(), turn.angle() * turn.axis();
  return T;
}

}  // namespace stillmap::mapping::loam
