#pragma once

#include <stillmap/maps/map_package.hpp>

#include <vector>

namespace stillmap::maps {

/// One point for each voxel that holds any: the one nearest to the voxel's centre; of those equally
/// near the one of most observations; of those again the first. Kept as it is and in its order.
///
/// @param points    relative to the map's origin; those that are not finite are dropped.
/// @param corner_x  with `corner_y` where the voxels begin, the tile's corner [m]; upwards they
///                  begin at the origin.
/// @param edge_m    of a voxel, > 0.
[[nodiscard]] std::vector<MapPoint> thinned_by_voxel(const std::vector<MapPoint>& points,
                                                     double corner_x, double corner_y,
                                                     double edge_m);

}  // namespace stillmap::maps
