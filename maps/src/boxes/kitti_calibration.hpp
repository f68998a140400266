#pragma once

#include <Eigen/Geometry>

#include <filesystem>

namespace stillmap::maps {

/// Rectified camera frame from lidar frame for a KITTI tracking label file: the `calib.txt` beside
/// it, or else the calibration of the nearest KITTI raw date folder above it.
/// @throws InputError naming the file when there is none, or a number is missing or not finite.
[[nodiscard]] Eigen::Affine3d read_T_rect_lidar(const std::filesystem::path& label_file);

}  // namespace stillmap::maps
