#pragma once

#include <stillmap/maps/error.hpp>
#include <stillmap/maps/map_package.hpp>

#include <fmt/format.h>
#include <Eigen/Core>

namespace stillmap::localization {

/// Calls `visit(p_map, point)` for every measured point of a map's finest tiles, tile by tile.
/// @throws maps::InputError naming the tile if a coordinate is not finite: what a package holds is
/// not checked when it is opened.
template <typename Visit>
void for_each_measured_point(const maps::MapPackage& map, const Visit& visit) {
  for (const maps::TileEntry& entry : map.manifest().tiles) {
    if (entry.id.level != 0) continue;
    const maps::MapTile tile = map.tile(entry.id);
    for (const maps::MapPoint& point : tile) {
      if (!maps::is_measured(point.kind)) continue;
      const Eigen::Vector3d p_map = tile.position(point);
      if (!p_map.allFinite()) {
        throw maps::InputError(
            map.folder().string(),
            fmt::format("a point of tile {}, {} that is not finite", entry.id.x, entry.id.y),
            "finite coordinates");
      }
      visit(p_map, point);
    }
  }
}

}  // namespace stillmap::localization
