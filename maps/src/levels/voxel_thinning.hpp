#pragma once

#include <stillmap/maps/map_package.hpp>

#include <vector>

namespace stillmap::maps {

/// One point for each voxel that holds any: the one nearest to the voxel's centre; of those equally
/// near the one of most observations; of those again the first. Kept as it is and in its order.
///
/// @param points  from their tile's corner, where the voxels begin; those that are not finite are
///                dropped.
/// @param edge_m  of a voxel, > 0.
[[nodiscard]] std::vector<MapPoint> thinned_by_voxel(const std::vector<MapPoint>& points,
                                                     double edge_m);

}  // namespace stillmap::maps
