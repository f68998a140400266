#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace stillmap::test {

/// Distance of two poses' origins [m]; NaN if either has one.
[[nodiscard]] inline double translation_error_m(const Eigen::Isometry3d& T_a,
                                                const Eigen::Isometry3d& T_b) {
  return (T_a.translation() - T_b.translation()).norm();
}

/// Angle between two poses' rotations [rad] in [0, pi]; NaN if either has one.
[[nodiscard]] inline double rotation_error_rad(const Eigen::Isometry3d& T_a,
                                               const Eigen::Isometry3d& T_b) {
  const Eigen::Matrix3d R = T_a.linear().transpose() * T_b.linear();
  const Eigen::Vector3d axis(R(2, 1) - R(1, 2), R(0, 2) - R(2, 0), R(1, 0) - R(0, 1));
  // atan2 keeps small angles exact, where acos of the trace alone has lost them.
  return std::atan2(0.5 * axis.norm(), 0.5 * (R.trace() - 1.0));
}

/// Equal to a pose within `translation_m` [m] and `rotation_rad` [rad], each apart. NaN never
/// matches.
///
///     EXPECT_THAT(result.T_map_lidar, IsNearPose(T_truth, 0.01, 1e-3));
MATCHER_P3(IsNearPose, T_expected, translation_m, rotation_rad,
           "is within " + ::testing::PrintToString(translation_m) + " m and " +
               ::testing::PrintToString(rotation_rad) + " rad of the pose") {
  const double off_m = translation_error_m(arg, T_expected);
  const double off_rad = rotation_error_rad(arg, T_expected);
  *result_listener << "off by " << off_m << " m and " << off_rad << " rad";
  return off_m <= translation_m && off_rad <= rotation_rad;
}

/// Equal to a vector within `tolerance` (largest coefficient). NaN and another size never match.
MATCHER_P2(IsNearVector, expected, tolerance,
           "is within " + ::testing::PrintToString(tolerance) + " of the vector") {
  if (arg.size() != expected.size()) {
    *result_listener << "size " << arg.size();
    return false;
  }
  *result_listener << "off by " << (arg - expected).transpose();
  return ((arg - expected).array().abs() <= tolerance).all();
}

}  // namespace stillmap::test
