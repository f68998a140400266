#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <span>

namespace stillmap::mapping {

/// Upward in the frame of odometry, from the specific force of the drive's IMU over the first scans
/// (at most 300): force = gravity's reaction + acceleration + the accelerometer's bias. The
/// acceleration between two scans is what their speeds differ by. The bias turns with the lidar, so
/// it is found where the lidar turns; elsewhere it tilts the vertical by its size, some 10 mm/s^2 a
/// milliradian.
/// @param begin  scan of the first pose. @param poses  of `run_odometry`.
/// @return a unit vector; nothing without a fitted IMU, with fewer than 10 scans, or where the
/// force is not that of gravity (9 to 10.6 m/s^2).
[[nodiscard]] std::optional<Eigen::Vector3d> up_in_odom(const maps::Drive& drive, std::size_t begin,
                                                        std::span<const OdometryPose> poses);

}  // namespace stillmap::mapping
