#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Geometry>

namespace stillmap::mapping {

/// Pose of a scan in a frame whose origin is the ground below the sensor, z the ground's normal, x
/// as near to the lidar's as that lets it.
/// @param scan_lidar  deskewed; tilted by up to some 50 degrees, upright or hanging.
/// @return identity where the scan shows no ground around the sensor.
[[nodiscard]] Eigen::Isometry3d T_ground_lidar(const maps::PointCloud& scan_lidar);

}  // namespace stillmap::mapping
