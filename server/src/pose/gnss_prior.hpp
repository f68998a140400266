#pragma once

#include <stillmap/localization/aligner.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

#include <optional>
#include <span>

namespace stillmap::server {

/// Where a satellite receiver says that the lidar is (WGS 84).
struct GnssFix {
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  /// Above the ellipsoid [m]; receivers often tell the height above the sea, which is up to 100 m
  /// off.
  std::optional<double> altitude_m;
  /// One deviation of the horizontal position [m].
  double sigma_m = 0.0;
};

/// Bounds of a fix's deviation [m]: better than any receiver, and beyond what is any help.
inline constexpr double kMinGnssSigmaM = 0.01;
inline constexpr double kMaxGnssSigmaM = 1000.0;

/// A prior in the map frame: the fix's place, any heading. Heights of receivers count with 1.5
/// deviations of the horizontal; without one the height is that of the nearest pose that the map
/// was made from, and so is the attitude, since lidars are mounted alike.
/// @param origin  of the map frame. @param T_map_seen  poses that the map was made from, may be
/// none: then upright, at the origin's height.
[[nodiscard]] localization::Prior prior_from(const GnssFix& fix, const maps::GeodeticOrigin& origin,
                                             std::span<const Eigen::Isometry3d> T_map_seen);

}  // namespace stillmap::server
