#pragma once

/// Frames, units and time of every stillmap interface.
///
///   map    local metric frame of one map, east-north-up when the origin is known; else the first
///   base
///          pose with z up, or the frame of the poses that were given (kept as they are).
///   odom   like map, but allowed to drift.
///   base   the vehicle: x forward, y left, z up.
///   lidar  the sensor of one scan.
///
/// `T_a_b` takes points from frame b to frame a: `p_a = T_a_b * p_b`, so inner names meet:
/// `T_map_lidar = T_map_base * T_base_lidar`. Units are SI: metres, radians, seconds. Map
/// coordinates are double, or float relative to an origin kept beside them.
///
/// Time is nanoseconds in an int64 `stamp_ns`: since the Unix epoch, or since the start of the
/// drive when the drive has a relative clock (`Drive::relative_clock()`); never one turned into the
/// other.

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>

namespace stillmap::maps {

/// Brings a chain of products back into SO(3); products of many poses leave it otherwise.
[[nodiscard]] Eigen::Isometry3d renormalized(const Eigen::Isometry3d& T);

/// Exponential map of a twist (tx ty tz rx ry rz) [m, rad] with the full SE(3) coupling.
[[nodiscard]] Eigen::Isometry3d exp_se3(const Eigen::Matrix<double, 6, 1>& twist);

/// Inverse of `exp_se3`; rotation angle in [0, pi].
[[nodiscard]] Eigen::Matrix<double, 6, 1> log_se3(const Eigen::Isometry3d& T);

/// Rotation about a vector by its length [rad], and its inverse with a length in [0, pi].
[[nodiscard]] Eigen::Matrix3d exp_so3(const Eigen::Vector3d& rotation);
[[nodiscard]] Eigen::Vector3d log_so3(const Eigen::Matrix3d& R);

/// Roll, pitch and yaw of R = Rz(yaw) Ry(pitch) Rx(roll) [rad].
[[nodiscard]] Eigen::Vector3d roll_pitch_yaw_rad(const Eigen::Matrix3d& R);

/// Angle of a rotation [rad], in [0, pi].
[[nodiscard]] double rotation_angle_rad(const Eigen::Matrix3d& R);

}  // namespace stillmap::maps
