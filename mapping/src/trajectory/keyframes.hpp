#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <optional>

namespace stillmap::mapping {

/// What odometry loses on its way, as a random walk: deviations in every direction after a metre,
/// and what two scans at one place are off from each other. Neighbouring matches share their
/// errors, which their own covariances do not know.
struct OdometryDrift {
  double after_a_metre_m = 0.02;
  double after_a_metre_rad = 3.5e-4;
  double floor_m = 0.005;
  double floor_rad = 2e-4;

  /// Covariance after so long a way, order as in `OdometryPose`.
  [[nodiscard]] Eigen::Matrix<double, 6, 6> over(double way_m) const;
};

/// Picks scans that are far enough from the last one picked, and adds up what is not known of the
/// motion between them.
class KeyframeChooser {
 public:
  struct Chosen {
    /// From the key frame before; identity for the first.
    Eigen::Isometry3d T_before_this = Eigen::Isometry3d::Identity();
    /// Of it as the matches say, order as in `OdometryPose`; zero for the first.
    Eigen::Matrix<double, 6, 6> by_matches = Eigen::Matrix<double, 6, 6>::Zero();

    /// With what odometry loses on its way all the same.
    [[nodiscard]] Eigen::Matrix<double, 6, 6> covariance(const OdometryDrift& drift = {}) const {
      return by_matches + drift.over(T_before_this.translation().norm());
    }
  };
  /// The next scan's pose. @return nothing unless it becomes a key frame. The first scan that is
  /// not hidden does.
  [[nodiscard]] std::optional<Chosen> add(const OdometryPose& pose);

 private:
  bool begun_ = false;
  Eigen::Isometry3d T_odom_keyframe_ = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d T_odom_last_ = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance_ = Eigen::Matrix<double, 6, 6>::Zero();
  /// Of the hidden scans since the last one that was not: what counts where nothing was found again
  /// after them.
  Eigen::Matrix<double, 6, 6> hidden_ = Eigen::Matrix<double, 6, 6>::Zero();
};

}  // namespace stillmap::mapping
