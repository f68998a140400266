#include "trajectory/keyframes.hpp"

#include <stillmap/localization/adjoint.hpp>

#include <stillmap/maps/frames.hpp>

#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr double kKeyframesApartM = 1.0;
constexpr double kApartRad = 10.0 * std::numbers::pi / 180.0;
/// Drift as a random walk, deviations after a metre: 0.2 m and 0.2 deg after 100 m.
constexpr double kDriftM = 0.02;
constexpr double kDriftRad = 3.5e-4;
/// What two scans at one place are off from each other.
constexpr double kFloorM = 0.005;
constexpr double kFloorRad = 2e-4;

Eigen::Matrix<double, 6, 6> drift_over(double way_m) {
  const double variance_m2 = kDriftM * kDriftM * way_m + kFloorM * kFloorM;
  const double variance_rad2 = kDriftRad * kDriftRad * way_m + kFloorRad * kFloorRad;
  Eigen::Matrix<double, 6, 1> variances;
  variances << variance_m2, variance_m2, variance_m2, variance_rad2, variance_rad2, variance_rad2;
  return variances.asDiagonal();
}

}  // namespace

std::optional<KeyframeChooser::Chosen> KeyframeChooser::add(const OdometryPose& pose) {
  if (!begun_) {
    begun_ = true;
    T_odom_keyframe_ = T_odom_last_ = pose.T_odom_lidar;
    return Chosen{};
  }
  // An error before the last step, seen from after it.
  const Eigen::Isometry3d T_last_this = T_odom_last_.inverse() * pose.T_odom_lidar;
  const Eigen::Matrix<double, 6, 6> carry = localization::adjoint(T_last_this.inverse());
  covariance_ = carry * covariance_ * carry.transpose() + pose.covariance;
  T_odom_last_ = pose.T_odom_lidar;

  const Eigen::Isometry3d T_before_this = T_odom_keyframe_.inverse() * pose.T_odom_lidar;
  const double way_m = T_before_this.translation().norm();
  if (way_m < kKeyframesApartM && maps::rotation_angle_rad(T_before_this.linear()) < kApartRad)
    return std::nullopt;
  const Chosen chosen{T_before_this, covariance_ + drift_over(way_m)};
  T_odom_keyframe_ = pose.T_odom_lidar;
  covariance_.setZero();
  return chosen;
}

}  // namespace stillmap::mapping
