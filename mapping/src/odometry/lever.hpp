#pragma once

#include <Eigen/Core>

namespace stillmap::mapping {

/// Rotations count as metres at this distance, as in `localization::AlignmentResult`.
inline constexpr double kLeverM = 15.0;

/// A motion (tx ty tz rx ry rz) [m, rad] with its rotations in metres.
[[nodiscard]] inline Eigen::Matrix<double, 6, 1> in_metres(Eigen::Matrix<double, 6, 1> motion) {
  motion.tail<3>() *= kLeverM;
  return motion;
}

/// Rows and columns of the rotations times a factor.
[[nodiscard]] inline Eigen::Matrix<double, 6, 6> rotations_times(Eigen::Matrix<double, 6, 6> matrix,
                                                                 double factor) {
  matrix.bottomRows<3>() *= factor;
  matrix.rightCols<3>() *= factor;
  return matrix;
}

}  // namespace stillmap::mapping
