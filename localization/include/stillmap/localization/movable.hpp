#pragma once

#include <stillmap/maps/box.hpp>
#include <stillmap/maps/scan.hpp>

#include <span>

namespace stillmap::localization {

/// Longest edge of a box [m], beyond trams and road trains.
inline constexpr double kMaxBoxEdgeM = 100.0;
/// Farthest a box's centre may be from the sensor along each axis [m].
inline constexpr double kMaxBoxCentreM = 1e5;
/// What boxes are grown by unless said otherwise [m]; the mapper's own default.
inline constexpr double kMovableMarginM = 0.1;

/// A scan without its points inside boxes, for callers whose own detector has found what moves.
///
/// @param scan_lidar   N points [m] in the lidar frame, with or without attributes; those of a
/// point
///                     that goes go with it. The others keep their order.
/// @param boxes_lidar  in the lidar frame of that scan; they may overlap. Centre within
///                     `kMaxBoxCentreM`, edges in (0, `kMaxBoxEdgeM`], yaw finite.
/// @param margin_m     boxes are grown by this on every side, in [0, 10].
/// @throws std::invalid_argument naming the box, the value and its bound.
[[nodiscard]] maps::PointCloud without_points_in(const maps::PointCloud& scan_lidar,
                                                 std::span<const maps::Box> boxes_lidar,
                                                 double margin_m = kMovableMarginM);

}  // namespace stillmap::localization
