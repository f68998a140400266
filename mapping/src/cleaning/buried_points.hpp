#pragma once

#include "ground/fused_ground.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Finds the points of a scan that no ray can reach: measured ground lies between them and the
/// sensor. A wet road, a puddle or a polished floor shows what stands on it upside down below.
///
/// A point is buried when the ray to it runs below ground, by 0.1 m and 0.5 % of the range or more,
/// somewhere on its way within 35 m of the sensor. For a point that its scan took for ground these
/// are 0.4 m. The ground must have been measured often there, and the ray must have been above it
/// before. Ground that was filled in does not count, nor ground that begins with a step above the
/// ray: the top of a retaining wall, a bridge. So a ditch, a cellar's ramp or a road under a bridge
/// stays: the ray to it is above all ground that was measured.
///
/// Heights are compared after the scan was shifted onto the fused ground, by the median of what its
/// own ground points lie beside it, since poses drift in height from pass to pass.
/// @param positions      N points, lidar frame [m], finite.
/// @param is_ground      N flags. Of 50 ground points or fewer on measured ground nothing is said.
/// @param T_local_lidar  of the scan; local as in `PosedScan`. The sensor is at the lidar's origin.
/// @param ground         finished.
/// @return N flags, 1 = buried.
[[nodiscard]] std::vector<std::uint8_t> find_buried_points(
    std::span<const Eigen::Vector3f> positions, const std::vector<bool>& is_ground,
    const Eigen::Isometry3d& T_local_lidar, const FusedGround& ground);

}  // namespace stillmap::mapping
