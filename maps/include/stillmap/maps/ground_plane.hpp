#pragma once

#include <Eigen/Core>

#include <optional>
#include <span>

namespace stillmap::maps {

/// A plane that a sensor stands over: `up` from the plane towards the sensor, of unit length.
struct GroundPlane {
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  double height_m = 0.0;
};

/// The plane within 20 m that holds the most points and has next to nothing behind it: what is seen
/// of the world lies on the ground or above it. Found near the sensor's xy plane (30 deg), or else
/// anywhere if it holds much. @return nothing where there is none.
[[nodiscard]] std::optional<GroundPlane> find_ground_plane(std::span<const Eigen::Vector3f> points);

}  // namespace stillmap::maps
