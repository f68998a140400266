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
  const maps::MapManifest& manifest = map.manifest();
  for (const maps::TileEntry& entry : manifest.tiles) {
    if (entry.id.level != 0) continue;
    for (const maps::MapPoint& point : map.tile(entry.id)) {
      if (!maps::is_measured(point.kind)) continue;
      const Eigen::Vector3f p(point.x, point.y, point.z);
      if (!p.allFinite()) {
        throw maps::InputError(
            map.folder().string(),
            fmt::format("a point of tile {}, {} that is not finite", entry.id.x, entry.id.y),
            "finite coordinates");
      }
      visit(Eigen::Vector3d(manifest.origin + p.cast<double>()), point);
    }
  }
}

}  // namespace stillmap::localization
