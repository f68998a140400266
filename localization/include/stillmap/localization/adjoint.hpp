#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace stillmap::localization {

/// Ad(T) of twists with the translation first: T exp(x) = exp(Ad(T) x) T.
[[nodiscard]] inline Eigen::Matrix<double, 6, 6> adjoint(const Eigen::Isometry3d& T) {
  const Eigen::Matrix3d R = T.linear();
  const Eigen::Vector3d t = T.translation();
  Eigen::Matrix<double, 6, 6> Ad = Eigen::Matrix<double, 6, 6>::Zero();
  Ad.topLeftCorner<3, 3>() = R;
  Ad.bottomRightCorner<3, 3>() = R;
  for (Eigen::Index k = 0; k < 3; ++k) Ad.block<3, 1>(0, 3 + k) = t.cross(R.col(k));
  return Ad;
}

}  // namespace stillmap::localization
