#pragma once

#include "ground/cell_points.hpp"
#include "ground/plane_fit.hpp"

#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// What is found in one patch of the zone model.
struct RegionFit {
  PlaneFit plane;
  /// Points on upright planes that were set aside.
  int vertical_points = 0;
};

/// Region-wise vertical plane fitting, then region-wise ground plane fitting.
///
/// Seeds are the points little above the mean of the lowest ones. As long as the plane through them
/// is steep, the points on it are set aside (a wall that reaches below the ground's level, as at a
/// terrace). The rest gives a plane from seeds again, refined by the points within 12.5 cm.
///
/// Departures: points farther below the plane than they may be above it are no ground either, so
/// reflections do not tilt it; heights are over the plane under the sensor, so that a street's
/// slope leaves the lowest points spread over the patch; verticals are looked for in all zones, as
/// in the paper (the authors' program: in the innermost).
/// @param points           of one patch, levelled.
/// @param deepest_seed_m   points farther below the plane under the sensor seed nothing.
/// @param scratch          working memory, kept between calls to save its allocation.
/// @return nothing for fewer than 10 points or when fewer than 3 are left on a plane.
/// @see Patchwork++, IROS 2022, region-wise vertical plane fitting; Patchwork, RA-L 2021,
/// region-wise ground plane fitting.
[[nodiscard]] std::optional<RegionFit> fit_region(std::span<const CellPoint> points,
                                                  double deepest_seed_m,
                                                  std::vector<CellPoint>& scratch);

}  // namespace stillmap::mapping
