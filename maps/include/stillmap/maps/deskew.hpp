#pragma once

#include <stillmap/maps/scan.hpp>

#include <Eigen/Core>

namespace stillmap::maps {

/// Moves every point to the scan's stamp: p <- exp(twist * time_offset) p; its time is then 0. Does
/// nothing without per-point times. If the cloud has a `turn`, points are turned by that, and only
/// the way is the twist's: p <- R_stamp_then p + v * time_offset.
/// @param twist_lidar  (tx ty tz rx ry rz) [m/s, rad/s] of the sensor, in its own frame.
void deskew(PointCloud& cloud, const Eigen::Matrix<double, 6, 1>& twist_lidar);

}  // namespace stillmap::maps
