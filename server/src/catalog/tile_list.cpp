#include "catalog/tile_list.hpp"

namespace stillmap::server {
namespace {

bool touches(const Eigen::AlignedBox2d& area, const maps::TileEntry& tile) {
  const Eigen::AlignedBox3d bounds = tile.from_origin();
  return area.intersects({bounds.min().head<2>(), bounds.max().head<2>()});
}

}  // namespace

TilePage list_tiles(const maps::MapPackage& map, const std::optional<Eigen::AlignedBox2d>& area,
                    std::size_t limit, std::optional<std::int64_t> before) {
  TilePage page;
  // The number of the tile that comes next, if it is there.
  auto number = static_cast<std::int64_t>(map.manifest().extent.tiles);
  std::int64_t last = 0;
  const auto take = [&](const std::vector<maps::TileEntry>& tiles) {
    for (auto tile = tiles.rbegin(); tile != tiles.rend() && !page.next; ++tile, --number) {
      if ((before && number >= *before) || (area && !touches(*area, *tile))) continue;
      if (page.tiles.size() == limit) {
        page.next = last;
        return;
      }
      page.tiles.push_back(*tile);
      last = number;
    }
  };
  // Those of schema 1 are at hand, and some are of no region.
  take(map.manifest().tiles);
  if (map.manifest().schema == 1) return page;
  const std::vector<maps::RegionId> regions = map.regions();
  for (auto region = regions.rbegin(); region != regions.rend() && !page.next; ++region)
    take(map.tiles(*region));
  return page;
}

}  // namespace stillmap::server
