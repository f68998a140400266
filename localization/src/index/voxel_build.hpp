#pragma once

#include "index/index_bytes.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <vector>

namespace stillmap::localization {

/// Voxels of all levels from a map's measured points. @throws as `MapIndex::build`.
[[nodiscard]] IndexContent build_voxels(const maps::MapPackage& map,
                                        const MapIndexOptions& options);
/// Same from points [m] in the map frame.
[[nodiscard]] IndexContent build_voxels(const std::vector<Eigen::Vector3d>& points_map,
                                        const MapIndexOptions& options);

}  // namespace stillmap::localization
