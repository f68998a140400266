#pragma once

#include <stillmap/mapping/odometry.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Poses of all scans of a drive from those of its key frames: each scan follows the key frames
/// before and after it, as far as it is from them along the way. Key frames get exactly theirs;
/// scans beyond the last one follow it alone, and those before the first one that.
/// @param odometry   one a scan.
/// @param keyframes  numbers of scans, ascending, at least one.
/// @param T_map_keyframe  one a key frame.
[[nodiscard]] std::vector<Eigen::Isometry3d> corrected_poses(
    std::span<const OdometryPose> odometry, std::span<const std::size_t> keyframes,
    std::span<const Eigen::Isometry3d> T_map_keyframe);

}  // namespace stillmap::mapping
