#pragma once

#include <stillmap/maps/labelled_boxes.hpp>

#include <Eigen/Geometry>

#include <filesystem>

namespace stillmap::maps {

/// Rectified camera frame from lidar frame for a KITTI label file: the `calib.txt` beside it, or
/// else `../calib/` with a file of its name, or else the calibration of the nearest KITTI raw date
/// folder above it.
/// @throws InputError naming the file when there is none, or a number is missing or not finite.
[[nodiscard]] Eigen::Affine3d read_T_rect_lidar(const std::filesystem::path& label_file);

/// The left colour camera of the same calibration, without regions.
/// @throws InputError likewise, and when neither the calibration nor its focal length tells the
/// image's size.
[[nodiscard]] CameraView read_camera_view(const std::filesystem::path& label_file);

}  // namespace stillmap::maps
