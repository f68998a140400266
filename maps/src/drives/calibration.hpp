#pragma once

#include <Eigen/Geometry>

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace stillmap::maps {

/// A KITTI calibration file: `key: numbers` a line, by key; lines whose values are no numbers
/// (dates) are left out.
/// @throws StorageError.
[[nodiscard]] std::map<std::string, std::vector<double>> read_calibration(
    const std::filesystem::path& file);

/// @throws InputError naming `file` when two sensors of one vehicle would be further than 1000 m
/// apart along an axis.
void check_lever_arm(const Eigen::Vector3d& t_m, const std::filesystem::path& file);

/// T_velo_imu of `calib_imu_to_velo.txt` (`R:` 9 numbers, `T:` 3). @throws InputError, also when it
/// is missing.
[[nodiscard]] Eigen::Isometry3d read_T_velo_imu(const std::filesystem::path& file);

/// T_cam_velo of an odometry or tracking `calib.txt` (`Tr`, `Tr_velo_to_cam` or `Tr_velo_cam`, 12
/// numbers).
/// @throws InputError, also when it is missing.
[[nodiscard]] Eigen::Isometry3d read_T_cam_velo(const std::filesystem::path& file);

}  // namespace stillmap::maps
