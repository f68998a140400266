#pragma once

#include <Eigen/Geometry>

#include <cstddef>
#include <filesystem>
#include <span>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {

/// 3x4 row-major [R t], renormalized when within 1e-3 of SO(3).
/// @param line  of the file, for messages. @throws InputError naming file, line and value.
[[nodiscard]] Eigen::Isometry3d pose_of_matrix(const std::filesystem::path& file, std::size_t line,
                                               std::span<const double, 12> n);
/// The same of a line of 12 numbers.
[[nodiscard]] Eigen::Isometry3d parse_kitti_pose(const std::filesystem::path& file,
                                                 const NumberLine& line);

/// tx ty tz qx qy qz qw, normalized when within 1e-3 of norm 1. @throws as above.
[[nodiscard]] Eigen::Isometry3d pose_of_quaternion(const std::filesystem::path& file,
                                                   std::size_t line, std::span<const double, 7> n);

}  // namespace stillmap::maps
