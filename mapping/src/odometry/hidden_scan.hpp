#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <span>

namespace stillmap::mapping {

/// Whether points lie all around the sensor at one and the same short range, or all within a metre
/// of it: what covers a sensor, and no place that one could be in. For a sensor that looks to one
/// side, the latter alone: a wall before it is a place.
/// @param points_lidar  [m], finite.
[[nodiscard]] bool is_shell(std::span<const Eigen::Vector3f> points_lidar);

/// Two scans of a sensor never have the same points to the bit, not even while it stands.
/// @return the same for the same points in the same order, another one for others; 0 for none.
[[nodiscard]] std::uint64_t content_of(const maps::PointCloud& cloud);

}  // namespace stillmap::mapping
