#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::localization {

/// What happens to points that no other is near, as rain, dust and crosstalk give them. A scan of
/// fewer than 10,000 points, and one that was thinned before (many lone ones near the sensor),
/// keeps them.
enum class Lone { kKept, kLeftOut };

/// Points nearer than this are the vehicle itself [m]; `AlignerOptions::own_vehicle_m` says why.
inline constexpr double kOwnVehicleM = 2.7;

/// Which points of a scan stand for all of it: the first in each cell, those left out that lie
/// beyond 500 m (no lidar of ours sees so far, and they would overflow the grid) or on the vehicle
/// itself, which no map holds: nearer than `own_vehicle_m`, unless a quarter of the scan is.
/// @param positions  N points [m] in the lidar frame. Larger scans than 400,000 are strided first.
/// @param cell_m     edge of a cell, above 0.
/// @return indices, ascending.
[[nodiscard]] std::vector<std::size_t> one_point_a_cell(std::span<const Eigen::Vector3f> positions,
                                                        float cell_m, Lone lone = Lone::kKept,
                                                        double own_vehicle_m = kOwnVehicleM);

}  // namespace stillmap::localization
