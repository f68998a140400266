#pragma once

#include <stillmap/maps/box.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>

namespace stillmap::mapping {

/// A box of the lidar frame in the map frame, yaw included. Boxes stand upright in both: a tilt of
/// the sensor turns the heading and nothing else.
[[nodiscard]] maps::Box to_map(const maps::Box& box, const Eigen::Isometry3d& T_map_lidar);

/// The reverse. Exact back and forth without tilt; with a tilt of t the heading returns within
/// t^2 / 2.
[[nodiscard]] maps::Box to_lidar(const maps::Box& box_map, const Eigen::Isometry3d& T_map_lidar);

/// Corners seen from above, counter-clockwise [m].
[[nodiscard]] std::array<Eigen::Vector2d, 4> corners_of(const maps::Box& box);

/// Area that two turned boxes share seen from above [m^2].
[[nodiscard]] double shared_area_m2(const maps::Box& a, const maps::Box& b);

/// Shared area over the joint one, and over that of the smaller box; both in [0, 1].
struct BoxOverlap {
  double of_joint = 0.0;
  double of_smaller = 0.0;
};
[[nodiscard]] BoxOverlap overlap_of(const maps::Box& a, const maps::Box& b);

}  // namespace stillmap::mapping
