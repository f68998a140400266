#pragma once

#include "ground/cell_points.hpp"
#include "ground/height_grid.hpp"

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Flags the points that lie on the ground's surface.
///
/// A point may be a kerb's height off the surface, but only little above it where something stands:
/// there it would be the bottom of a wall, a tyre or a foot.
/// @param points     in the frame of the grid.
/// @param is_ground  a flag for each point of the cloud; those of ground are set to 1.
void label_ground(const CellPoints& points, const HeightGrid& grid,
                  std::vector<std::uint8_t>& is_ground);

}  // namespace stillmap::mapping
