#pragma once

#include "residual_rows.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace stillmap::localization {

/// A pose with a Gaussian error.
struct PosePdf {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  /// Rows tx ty tz [m], rx ry rz [rad]; perturbation on the right, in the pose's own frame.
  Matrix6d covariance = Matrix6d::Identity();
};

/// Pose and motion put together: T_a_b T_b_c with both errors, which are independent. First order.
[[nodiscard]] PosePdf composed(const PosePdf& T_a_b, const PosePdf& T_b_c);

/// The more likely pose in between, and its covariance, from two independent estimates of one pose
/// that lie less than 1 rad apart.
[[nodiscard]] PosePdf fused(const PosePdf& a, const PosePdf& b);

/// Squared distance of two independent estimates of one pose in deviations; chi-squared with 6
/// degrees of freedom when both are true. NaN when a covariance cannot be inverted.
[[nodiscard]] double chi_squared(const PosePdf& a, const PosePdf& b);
/// Its 99.9 % point: two estimates beyond it contradict each other.
inline constexpr double kMaxChiSquared = 22.46;

}  // namespace stillmap::localization
