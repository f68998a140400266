#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace stillmap::mapping::loam {

/// Motion of the sensor during a sweep, T of the paper: (t, theta), [m] and a rotation vector
/// [rad], that takes points from the lidar frame at this sweep's stamp to that at the stamp before.
using Motion = Eigen::Matrix<double, 6, 1>;

/// Eq. (6) to (8): R = exp(hat(theta)) by Rodrigues.
[[nodiscard]] Eigen::Matrix3d rotation(const Eigen::Vector3d& theta);

/// Share of the motion that a point has behind it, eq. (4): T_i = s T. The paper counts from the
/// sweep's start; here both ends are stamps, so a point at the stamp has s = 1.
/// @param time_s  of the point, relative to its scan's stamp. @param period_s  between stamps, > 0.
[[nodiscard]] inline double share_of(double time_s, double period_s) {
  return 1.0 + time_s / period_s;
}

/// How much of a sweep's motion a point has behind it. Of points that a gyroscope has turned to the
/// stamp already it is the whole turn.
struct Share {
  double way = 1.0;
  double turn = 1.0;

  bool operator==(const Share&) const = default;
};

/// The motion up to some share of it, eq. (4) and (5): X_before = R(s theta) X + s t. Points of one
/// share after another cost one rotation.
class PartOfMotion {
 public:
  explicit PartOfMotion(const Motion& T) : T_(T) { set({}); }
  void go_to(const Share& share) {
    if (share != share_) set(share);
  }
  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& X) const { return R_ * X + t_; }
  /// Derivative of the product by T, 3 x 6, exact.
  [[nodiscard]] Eigen::Matrix<double, 3, 6> jacobian(const Eigen::Vector3d& X) const;

 private:
  void set(const Share& share);

  Motion T_;
  Share share_;
  Eigen::Matrix3d R_;
  Eigen::Vector3d t_;
  /// s J_r(s theta), J_r the right Jacobian of SO(3).
  Eigen::Matrix3d turn_;
};

[[nodiscard]] Eigen::Isometry3d isometry(const Motion& T);
[[nodiscard]] Motion motion(const Eigen::Isometry3d& T_before_now);

[[nodiscard]] Eigen::Matrix3d hat(const Eigen::Vector3d& v);

}  // namespace stillmap::mapping::loam
