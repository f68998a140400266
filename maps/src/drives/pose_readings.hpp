#pragma once

#include <stillmap/maps/drive_check.hpp>

#include <Eigen/Geometry>

#include <string>
#include <vector>

namespace stillmap::maps {

/// What stands around the sensor, without the ground.
using StandingPoints = std::vector<Eigen::Vector3f>;

struct PosedScan {
  Eigen::Isometry3d T_map_lidar = Eigen::Isometry3d::Identity();
  StandingPoints points;
};

/// Compares the poses as they are with what they might be instead: no motion at all, their
/// inverses, poses of a frame whose axes point elsewhere (a camera's, a vehicle's), and the
/// inverses of these. In pairs that lie apart by their poses; equal ones say nothing.
/// @return nothing with fewer than `least_pairs`.
[[nodiscard]] std::optional<PoseOverlap> compare_readings(
    const std::vector<std::array<PosedScan, 2>>& pairs, std::size_t least_pairs = 4);

/// Shares of readings that differ by more tell them apart: they differ by 0.3 and more where scans
/// lie a metre apart, and by 0.02 from noise.
inline constexpr double kClearlyBetter = 0.1;
/// Whether a reading is better than the given one beyond doubt.
[[nodiscard]] bool is_better(double overlap, const PoseOverlap& given);

}  // namespace stillmap::maps
