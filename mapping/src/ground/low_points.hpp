#pragma once

#include "ground/cell_points.hpp"
#include "ground/seed_plane.hpp"

#include <optional>

namespace stillmap::mapping {

/// The ground's plane under the sensor, from low points of the cells around it.
/// @param points  not levelled.
[[nodiscard]] std::optional<SeedPlane> find_plane_under_sensor(
    const CellPoints& points, const std::optional<HeightPrior>& prior);

}  // namespace stillmap::mapping
