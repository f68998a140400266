#pragma once

#include <Eigen/Geometry>

#include <filesystem>

#include <stillmap/maps/text.hpp>

namespace stillmap::maps {

/// 12 numbers, 3x4 row-major [R t], renormalized when within 1e-3 of SO(3).
/// @throws InputError naming file, line and value.
[[nodiscard]] Eigen::Isometry3d parse_kitti_pose(const std::filesystem::path& file,
                                                 const NumberLine& line);

}  // namespace stillmap::maps
