#pragma once

#include "loops/loop_finder.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A scan of a drive that stands for those around it.
struct DriveKeyframe {
  std::size_t drive = 0;
  std::size_t scan = 0;
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// From the key frame of the drive before it, and its covariance; identity and zero for the
  /// first.
  Eigen::Isometry3d T_before_this = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// First guess of where the odometry frames of the drives lie: that of drive 0 is the common one,
/// the others are hung onto it, drive by drive, by the loop that agrees best with the others
/// between the same two drives.
/// @return `T_common_odom`, one a drive; nothing for a drive that no chain of loops leads to.
[[nodiscard]] std::vector<std::optional<Eigen::Isometry3d>> join_by_loops(
    std::size_t drives, std::span<const DriveKeyframe> keyframes, std::span<const Loop> loops);

}  // namespace stillmap::mapping
