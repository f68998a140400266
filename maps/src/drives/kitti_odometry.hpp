#pragma once

#include <stillmap/maps/drive.hpp>

#include "drives/layout.hpp"

#include <filesystem>

namespace stillmap::maps {

[[nodiscard]] bool is_kitti_odometry(const std::filesystem::path& root);

/// A sequence of KITTI odometry or SemanticKITTI: `velodyne/*.bin`, `times.txt`, `poses.txt` (or
/// `../../poses/SEQUENCE.txt`) of camera 0 with `calib.txt`, and `labels/*.label`; all but the
/// scans may be missing, the calibration only when there are no poses. The map frame is the first
/// scan's lidar frame when the first pose is the identity, as it is in KITTI. KITTI's own sweeps
/// are motion-compensated, so points have no times.
/// @param choice      its file, if any, replaces the sequence's own poses.
[[nodiscard]] Drive::Contents open_kitti_odometry(const std::filesystem::path& root,
                                                  const PosesChoice& choice);

}  // namespace stillmap::maps
