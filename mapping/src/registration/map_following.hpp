#pragma once

#include <stillmap/maps/small_matrices.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// Where a scan of a drive was found in a map.
struct FoundScan {
  /// Of the drive.
  std::size_t scan = 0;
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  /// Of the pose, as `FrameSight`.
  maps::Matrix6d covariance = maps::Matrix6d::Identity();
};

/// Poses of a drive bent so that they follow a map where scans were found in it: each is moved by
/// what the scans found within 15 m of the way are off by (a line through them, weighted by their
/// covariances and their distance), where no scan is near by what lies between the next two, and
/// beyond the last one as there. So a map
/// whose poses bend otherwise than the drive's meets the drive without a seam, and the noise of
/// single answers is averaged away.
/// @param T_map_lidar  in the map's frame, off by some decimetres at most.
/// @param found        by scan, ascending, each agreed with; none changes nothing.
[[nodiscard]] std::vector<Eigen::Isometry3d> following(std::vector<Eigen::Isometry3d> T_map_lidar,
                                                       const std::vector<FoundScan>& found);

/// Of each pose, whether a scan was found within 15 m of it along the way: then it is known by the
/// map. @param T_map_lidar, found  as `following`.
[[nodiscard]] std::vector<bool> known_by_map(const std::vector<Eigen::Isometry3d>& T_map_lidar,
                                             const std::vector<FoundScan>& found);

}  // namespace stillmap::mapping
