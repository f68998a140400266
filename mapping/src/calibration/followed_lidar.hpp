#pragma once

#include <stillmap/mapping/lidar_calibration.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <vector>

#include "calibration/hand_eye.hpp"

namespace stillmap::mapping {

/// One lidar as odometry followed it.
struct FollowedLidar {
  const maps::Drive& drive;
  /// In the frame of its own first scan. Stamps of the reference's clock.
  maps::Trajectory path;
  /// One a scan, as `OdometryPose::twist_lidar`.
  std::vector<Eigen::Matrix<double, 6, 1>> twists;
  /// Added to the drive's stamps.
  std::int64_t offset_ns = 0;
};

/// Where one scan of the lidar was found from the reference.
struct MountSight {
  /// When, by the reference's clock.
  std::int64_t stamp_ns = 0;
  Eigen::Isometry3d T_reference_lidar = Eigen::Isometry3d::Identity();
  /// As in `AlignmentResult`.
  maps::Matrix6d covariance = maps::Matrix6d::Zero();
  double inlier_ratio = 0.0;
};

struct SightSearch {
  const FollowedLidar& reference;
  const FollowedLidar& lidar;
  Eigen::Isometry3d T_reference_lidar = Eigen::Isometry3d::Identity();
  /// How far the mount may be off at some 15 m [m].
  double off_m = 0.3;
  /// Looks around widely first.
  bool widely = false;
  std::size_t most_scans = 0;
  int threads = 0;
  const ProgressCallback& progress;
};

/// Aligns scans of the lidar, spread over the drive, with what the reference saw from before until
/// a second after them.
[[nodiscard]] std::vector<MountSight> find_sights(const SightSearch& search,
                                                  const CancelFlag& cancel);

}  // namespace stillmap::mapping
