#include "catalog/tile_diff.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

namespace stillmap::server {
namespace {

/// Distance of a point from a tile's square, 0 inside [m].
double distance_m(const maps::TileId& id, const Eigen::Vector2d& from_origin) {
  const double width_m = std::ldexp(maps::kTileSizeM, static_cast<int>(id.level));
  const Eigen::Vector2d low = maps::corner_of(id).head<2>();
  const Eigen::Vector2d nearest =
      from_origin.cwiseMax(low).cwiseMin(low + Eigen::Vector2d::Constant(width_m));
  return (from_origin - nearest).norm();
}

/// Those of the level that was asked for, by x, then y.
std::vector<maps::TileEntry> tiles_near(const maps::MapPackage& package,
                                        const TileDiffRequest& request,
                                        const Eigen::Vector2d& from_origin) {
  std::vector<maps::TileEntry> near;
  const auto add = [&](const maps::TileEntry& tile) {
    if (tile.id.level == request.level && distance_m(tile.id, from_origin) <= request.radius_m)
      near.push_back(tile);
  };
  // The oldest packages have tiles of higher levels.
  if (request.level > 0) {
    for (const maps::TileEntry& tile : package.manifest().tiles) add(tile);
    return near;
  }
  constexpr std::uint32_t kLevelOfRegions = 5;
  static_assert(maps::kRegionTiles == 1 << kLevelOfRegions);
  for (const maps::RegionId region : package.regions()) {
    if (distance_m({kLevelOfRegions, region.x, region.y}, from_origin) > request.radius_m) continue;
    for (const maps::TileEntry& tile : package.tiles(region)) add(tile);
  }
  std::sort(near.begin(), near.end(),
            [](const maps::TileEntry& a, const maps::TileEntry& b) { return a.id < b.id; });
  return near;
}

}  // namespace

TileDiff tile_diff(const ServedVersion& map, const TileDiffRequest& request) {
  const maps::MapManifest& manifest = map.package->manifest();
  const Eigen::Vector2d from_origin = request.centre_map - manifest.origin.head<2>();
  const std::set<std::string_view> cached(request.cached_ids.begin(), request.cached_ids.end());
  TileDiff diff{.version = map.version, .add = {}, .remove = {}};
  std::set<std::string, std::less<>> wanted;
  for (const maps::TileEntry& tile : tiles_near(*map.package, request, from_origin)) {
    const std::string place = fmt::format("{}/{}/{}", tile.id.level, tile.id.x, tile.id.y);
    const std::string id = map.version + "/" + place;
    wanted.insert(id);
    if (cached.contains(id)) continue;
    diff.add.push_back(
        {id, tile, manifest.origin + maps::corner_of(tile.id),
         fmt::format("/v1/maps/{}/versions/{}/tiles/{}", map.map, map.version, place)});
  }
  std::set<std::string_view> seen;
  for (const std::string& id : request.cached_ids)
    if (!wanted.contains(id) && seen.insert(id).second) diff.remove.push_back(id);
  return diff;
}

}  // namespace stillmap::server
