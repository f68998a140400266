#include "trajectory/keyframes.hpp"

#include <stillmap/localization/adjoint.hpp>

#include <stillmap/maps/frames.hpp>

#include <numbers>

namespace stillmap::mapping {
namespace {

constexpr double kKeyframesApartM = 1.0;
constexpr double kApartRad = 10.0 * std::numbers::pi / 180.0;

}  // namespace

Eigen::Matrix<double, 6, 6> OdometryDrift::over(double way_m) const {
  const auto variance = [way_m](double after_a_metre, double floor) {
    return after_a_metre * after_a_metre * way_m + floor * floor;
  };
  Eigen::Matrix<double, 6, 1> variances;
  variances.head<3>().setConstant(variance(after_a_metre_m, floor_m));
  variances.tail<3>().setConstant(variance(after_a_metre_rad, floor_rad));
  return variances.asDiagonal();
}

std::optional<KeyframeChooser::Chosen> KeyframeChooser::add(const OdometryPose& pose) {
  if (pose.hidden) {
    hidden_ += pose.covariance;
    return std::nullopt;
  }
  if (!begun_) {
    begun_ = true;
    T_odom_keyframe_ = T_odom_last_ = pose.T_odom_lidar;
    hidden_.setZero();
    return Chosen{};
  }
  // An error before the last step, seen from after it.
  const Eigen::Isometry3d T_last_this = T_odom_last_.inverse() * pose.T_odom_lidar;
  const Eigen::Matrix<double, 6, 6> carry = localization::adjoint(T_last_this.inverse());
  covariance_ = carry * covariance_ * carry.transpose() + pose.covariance;
  // A scan that is matched tells the way over the hidden ones.
  if (pose.status != OdometryStatus::kMatched) covariance_ += hidden_;
  hidden_.setZero();
  T_odom_last_ = pose.T_odom_lidar;

  const Eigen::Isometry3d T_before_this = T_odom_keyframe_.inverse() * pose.T_odom_lidar;
  const double way_m = T_before_this.translation().norm();
  if (way_m < kKeyframesApartM && maps::rotation_angle_rad(T_before_this.linear()) < kApartRad)
    return std::nullopt;
  const Chosen chosen{T_before_this, covariance_};
  T_odom_keyframe_ = pose.T_odom_lidar;
  covariance_.setZero();
  return chosen;
}

}  // namespace stillmap::mapping
