#pragma once

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>
#include <Eigen/Core>

namespace stillmap::localization {

/// Calls `visit(p, point)` for every measured point of a tile, with `p` relative to the map's
/// origin [m].
/// @throws maps::InputError naming the tile if a coordinate is not finite: what a package holds is
/// not checked when it is opened.
template <typename Visit>
void for_each_measured_point(const maps::MapPackage& map, maps::TileId id, const Visit& visit) {
  const maps::MapTile tile = map.tile(id);
  for (const maps::MapPoint& point : tile) {
    if (!maps::is_measured(point.kind)) continue;
    const Eigen::Vector3d p = tile.from_origin(point);
    if (!p.allFinite()) {
      throw maps::InputError(map.folder().string(),
                             fmt::format("a point of tile {}, {} that is not finite", id.x, id.y),
                             "finite coordinates");
    }
    visit(p, point);
  }
}

}  // namespace stillmap::localization
