#pragma once

#include <Eigen/Geometry>

#include <array>
#include <cstdint>
#include <vector>

#include "ray_scene.hpp"
#include "sensor.hpp"

namespace stillmap::simulation {

/// One sweep as it goes to the file.
struct SimulatedScan {
  /// x y z [m] in the lidar frame and intensity in [0, 1].
  std::vector<std::array<float, 4>> points;
  /// SemanticKITTI class in the lower 16 bits, actor's index + 1 (0 = none) in the upper ones; one
  /// a point.
  std::vector<std::uint32_t> labels;
};

/// Takes a scan at one instant.
///
/// @param key  all random numbers of the scan follow from it and the ray's own number.
/// @note Rays are cast by the threads of the calling TBB arena; the result does not depend on them.
[[nodiscard]] SimulatedScan take_scan(const World& world, const RayScene& scene,
                                      const Sensor& sensor, const Eigen::Isometry3d& T_world_lidar,
                                      std::uint64_t key);

/// True boxes of the actors that a scan has points on, in its lidar frame; `track` = index + 1.
[[nodiscard]] std::vector<maps::Box> boxes_of_scan(const World& world, const SimulatedScan& scan,
                                                   const Eigen::Isometry3d& T_world_lidar,
                                                   double time_s);

}  // namespace stillmap::simulation
