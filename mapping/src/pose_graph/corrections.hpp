#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// Poses of all scans from those of the keyframes among them.
///
/// A scan between two keyframes keeps what odometry says of the way from each of them; the two
/// answers differ by what the graph changed in between, and are blended along the geodesic of SE(3)
/// by the way driven (by the count of scans where nothing moved). At a keyframe exactly its pose;
/// before the first and after the last one, that one's correction alone.
/// @param T_odom_lidar  of every scan, N >= 1.
/// @param keyframes     scans that are keyframes, increasing, at least one.
/// @param T_map_lidar   of each keyframe.
/// @return T_map_lidar of every scan.
/// @throws std::invalid_argument naming what does not fit.
[[nodiscard]] std::vector<Eigen::Isometry3d> corrected_poses(
    const std::vector<Eigen::Isometry3d>& T_odom_lidar, const std::vector<std::size_t>& keyframes,
    const std::vector<Eigen::Isometry3d>& T_map_lidar);

}  // namespace stillmap::mapping
