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

/// Eq. (5) with eq. (4): X_before = R(s theta) X + s t.
[[nodiscard]] Eigen::Vector3d to_before(const Motion& T, double share, const Eigen::Vector3d& X);

/// Derivative of `to_before` by T, 3 x 6, exact.
[[nodiscard]] Eigen::Matrix<double, 3, 6> to_before_jacobian(const Motion& T, double share,
                                                             const Eigen::Vector3d& X);

[[nodiscard]] Eigen::Isometry3d isometry(const Motion& T);
[[nodiscard]] Motion motion(const Eigen::Isometry3d& T_before_now);

[[nodiscard]] Eigen::Matrix3d hat(const Eigen::Vector3d& v);

}  // namespace stillmap::mapping::loam
