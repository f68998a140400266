#pragma once

#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <string>
#include <vector>

namespace stillmap::maps {

/// A fix of GNSS, and where its antenna was on a path.
struct FixOnPath {
  GeodeticOrigin place;
  /// [m], in the path's frame, whose z is up.
  Eigen::Vector3d p_map = Eigen::Vector3d::Zero();
};

/// Where a path lies on the Earth.
struct PlaceOnEarth {
  /// In the middle of the fixes.
  GeodeticOrigin origin;
  /// To east-north-up at the origin: a turn about z and a shift.
  Eigen::Isometry3d T_enu_map = Eigen::Isometry3d::Identity();
  /// Median distance of the fixes from the path, on the ground [m].
  double residual_m = 0.0;
};

/// The turn about z and the shift that bring a path to its fixes: least squares in the plane
/// (Umeyama, PAMI 1991, without scale), each fix weighted by Cauchy's function of its distance from
/// the path, so that some that are far off (multipath, the first after a start) do not pull; the
/// height is the median of the differences.
/// @param source  for messages. @throws InputError for fewer than 10 fixes, fixes along less than
/// 10 m (root mean square from their middle), or when their median distance from the path is above
/// 2 % of that: the heading of the map would be off by a degree.
[[nodiscard]] PlaceOnEarth place_on_earth(const std::vector<FixOnPath>& fixes,
                                          const std::string& source);

}  // namespace stillmap::maps
