#pragma once

#include "ground/cell_points.hpp"
#include "ground/seed_plane.hpp"

#include <optional>

namespace stillmap::mapping {

/// The ground's plane under the sensor, and with it the sensor's height and tilt, from low points
/// of the cells around it. The low point of a cell is on its lowest layer, not its lowest point, so
/// that scattered reflections below the road do not count.
///
/// Takes the place of Patchwork's all-terrain automatic height estimator, a consensus of heights,
/// which a tilted sensor and a sloping street defeat.
/// @param points  not levelled.
/// @param prior   a height that the plane must agree with.
[[nodiscard]] std::optional<SeedPlane> find_plane_under_sensor(
    const CellPoints& points, const std::optional<HeightPrior>& prior);

}  // namespace stillmap::mapping
