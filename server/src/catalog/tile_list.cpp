#include "catalog/tile_list.hpp"

#include <algorithm>

namespace stillmap::server {
namespace {

bool touches(const Eigen::AlignedBox2d& area, const maps::TileEntry& tile) {
  const Eigen::AlignedBox3d bounds = tile.from_origin();
  return area.intersects({bounds.min().head<2>(), bounds.max().head<2>()});
}

}  // namespace

TilePage list_tiles(const std::vector<maps::TileEntry>& tiles,
                    const std::optional<Eigen::AlignedBox2d>& area, std::size_t limit,
                    std::optional<std::int64_t> before) {
  TilePage page;
  std::size_t at = tiles.size();
  if (before) at = std::min(at, static_cast<std::size_t>(std::max<std::int64_t>(*before, 1) - 1));
  std::size_t last = 0;
  while (at > 0) {
    const maps::TileEntry& tile = tiles[--at];
    if (area && !touches(*area, tile)) continue;
    if (page.tiles.size() == limit) {
      page.next = static_cast<std::int64_t>(last);
      break;
    }
    page.tiles.push_back(tile);
    last = at + 1;
  }
  return page;
}

}  // namespace stillmap::server
