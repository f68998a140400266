#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <optional>

namespace stillmap::mapping {

/// Picks scans that are far enough from the last one picked, and adds up what is not known of the
/// motion between them.
class KeyframeChooser {
 public:
  struct Chosen {
    /// From the key frame before; identity for the first.
    Eigen::Isometry3d T_before_this = Eigen::Isometry3d::Identity();
    /// Of it, order as in `OdometryPose`. What the matches say, and what odometry loses on its way
    /// all the same: neighbouring matches share their errors, which their own covariances do not
    /// know. Zero for the first.
    Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  };
  /// The next scan's pose. @return nothing unless it becomes a key frame. The first scan does.
  [[nodiscard]] std::optional<Chosen> add(const OdometryPose& pose);

 private:
  bool begun_ = false;
  Eigen::Isometry3d T_odom_keyframe_ = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_odom_last_ = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance_ = Eigen::Matrix<double, 6, 6>::Zero();
};

}  // namespace stillmap::mapping
