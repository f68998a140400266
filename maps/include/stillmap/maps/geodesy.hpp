#pragma once

#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

namespace stillmap::maps {

/// East-north-up frame at `b`, seen from that at `a`: takes points [m] from the second to the first
/// (WGS 84, straight lines through the Earth, GeographicLib's LocalCartesian).
[[nodiscard]] Eigen::Isometry3d T_enu_enu(const GeodeticOrigin& a, const GeodeticOrigin& b);

/// The same frame seen from the Earth's centre (ECEF: x to 0 N 0 E, z to the North Pole).
[[nodiscard]] Eigen::Isometry3d T_ecef_enu(const GeodeticOrigin& origin);

}  // namespace stillmap::maps
