#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::localization {

/// What happens to points that have no other point near them, as from rain, dust and crosstalk.
/// They are always kept in a scan of fewer than 10,000 points, and in one that was thinned before
/// (many lone points near the sensor).
enum class Lone { kKept, kLeftOut };

/// Points nearer than this are the vehicle itself [m]; `AlignerOptions::own_vehicle_m` says why.
inline constexpr double kOwnVehicleM = 2.7;

/// Thins a scan to the first point of each cell. Points beyond 500 m are left out (no lidar of ours
/// sees so far, and they would overflow the grid). So are points nearer than `own_vehicle_m`, which
/// show the vehicle itself, unless a quarter of the scan is that near.
/// @param positions  N points [m] in the lidar frame. Larger scans than 400,000 are strided first.
/// @param cell_m     edge of a cell, above 0.
/// @return indices, ascending.
[[nodiscard]] std::vector<std::size_t> one_point_a_cell(std::span<const Eigen::Vector3f> positions,
                                                        float cell_m, Lone lone = Lone::kKept,
                                                        double own_vehicle_m = kOwnVehicleM);

}  // namespace stillmap::localization
