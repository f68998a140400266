#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <span>
#include <string>

namespace stillmap::mapping {

/// Upward in the frame of odometry: a unit vector. Nothing if it is not known.
struct Vertical {
  std::optional<Eigen::Vector3d> up_odom;
  /// Why it is not known, for people; empty without a fitted IMU.
  std::string fault;
};

/// Upward by the specific force of the drive's IMU over the first scans (at most 300): force =
/// gravity's reaction + acceleration + the accelerometer's bias. The acceleration between two scans
/// is what their speeds differ by. The bias turns with the lidar, so it is found where the lidar
/// turns; elsewhere it tilts the vertical by its size, some 10 mm/s^2 a milliradian.
/// Steps with a reading beyond 30 m/s^2 are left out.
/// @param begin  scan of the first pose. @param poses  of `run_odometry`.
/// @return a fault for fewer than 10 steps, or a force that is not that of gravity (9 to 10.6
/// m/s^2).
[[nodiscard]] Vertical up_in_odom(const maps::Drive& drive, std::size_t begin,
                                  std::span<const OdometryPose> poses);

/// Turns the frame of the ground until its z is upward by gravity. If the ground is seen and
/// differs by more than 20 deg, the accelerometer is taken to be wrong, and the frame stays.
/// @return what was done, for people; empty for a vertical that says nothing.
[[nodiscard]] std::string level(const Vertical& vertical, bool ground_is_seen,
                                Eigen::Isometry3d& T_ground_odom);

}  // namespace stillmap::mapping
