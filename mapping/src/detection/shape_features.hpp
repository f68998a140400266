#pragma once

#include "detection/column_grid.hpp"
#include "detection/rectangle_fit.hpp"

#include <vector>

namespace stillmap::mapping {

/// What tells the body of a vehicle from a hedge or a piece of a wall, from one scan.
struct ShapeFeatures {
  /// Largest share of the points on the lower body whose distances to the sides that face the
  /// sensor differ by 0.15 m at most: sheet metal is flat, leaves are not.
  double flatness = 0.0;
  /// How much farther from those sides the points at window height lie than those on the lower
  /// body, medians [m]: cabins lean inward.
  double inset_m = 0.0;
  /// Share of the length at which the shape reaches three quarters of its height: bonnets do not,
  /// walls and hedges do everywhere.
  double high_share = 0.0;
  /// Slope of its highest point seen from the sensor below the highest of the scan: none is left
  /// over a wall that leaves the field of view.
  double clearance = 0.0;
};

/// @param points       of one object, lidar frame, at least one.
/// @param top_slope    z over horizontal range of the scan's highest ring.
[[nodiscard]] ShapeFeatures features_of(const std::vector<RaisedPoint>& points,
                                        const Rectangle& rectangle, double top_slope);

}  // namespace stillmap::mapping
