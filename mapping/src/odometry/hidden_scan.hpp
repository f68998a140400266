#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <span>

namespace stillmap::mapping {

/// True if nearly all points are within 1 m, or lie all around the sensor at one short range
/// (< 15 m): the sensor is covered. A sensor that looks to one side is tested for 1 m only, because
/// a wall looks the same.
/// @param points_lidar  [m], finite.
[[nodiscard]] bool is_shell(std::span<const Eigen::Vector3f> points_lidar);

/// Two scans of a sensor never have the same points to the bit, not even while it stands.
/// @return the same for the same points in the same order, another one for others; 0 for none.
[[nodiscard]] std::uint64_t content_of(const maps::PointCloud& cloud);

}  // namespace stillmap::mapping
