#pragma once

#include <Eigen/Geometry>

#include <filesystem>
#include <optional>

namespace stillmap::maps {

/// KITTI-360's poses of a drive `data_3d_raw/NAME`: `data_poses/NAME/poses.txt`; nothing where they
/// do not exist.
[[nodiscard]] std::optional<std::filesystem::path> kitti360_poses(
    const std::filesystem::path& root);

/// The lidar in the frame of the poses of such a file, by `calibration/` beside `data_poses/`:
/// `poses.txt` is of the IMU, `cam0_to_world.txt` of the left camera after rectification
/// (`R_rect_00`). Nothing for another file.
/// Source: https://www.cvlibs.net/datasets/kitti-360/documentation.php, and kitti360scripts'
/// helpers/project.py for the rectification.
/// @throws InputError for a calibration that is missing or broken.
[[nodiscard]] std::optional<Eigen::Isometry3d> lidar_of_kitti360_poses(
    const std::filesystem::path& poses_file);

}  // namespace stillmap::maps
