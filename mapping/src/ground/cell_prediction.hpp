#pragma once

#include "ground/height_grid.hpp"

#include <Eigen/Core>

namespace stillmap::mapping {

/// Steepest ground over the plane under the sensor: a street that bends by 10 %, and a ramp.
inline constexpr double kMaxGroundSlope = 0.35;

/// A plane that a cell's ground is expected on: height at its centre and slope.
struct CellPrediction {
  double z = 0.0;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();
  /// Known cells that it rests on; 0 = no prediction.
  int supports = 0;
  /// Distance to the nearest of them [m].
  double gap_m = 0.0;
};

/// Weighted plane through the known nodes around a cell, itself left out. The slope is drawn to the
/// mean slope of those nodes, without which a single ring would leave it free across.
/// @param range_m  of the cell: the rings of a spinning sensor part with it, and so the search goes
/// farther.
[[nodiscard]] CellPrediction predict_from_neighbours(const HeightGrid& grid, int cell,
                                                     double range_m);

/// The plane of the next known node on the way to the sensor, up to half of the range away.
[[nodiscard]] CellPrediction predict_along_ray(const HeightGrid& grid, int cell, double range_m);

}  // namespace stillmap::mapping
