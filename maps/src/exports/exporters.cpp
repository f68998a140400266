#include "exports/exporters.hpp"

#include <fmt/format.h>
#include <stillmap/maps/error.hpp>

#include <algorithm>
#include <array>
#include <iterator>

namespace stillmap::maps {
namespace {

/// Formats size their grids and headers by what the manifest says.
bool is_usable(const MapTile& tile, const MapPoint& point, const Eigen::AlignedBox3d& bounds) {
  return bounds.contains(tile.from_origin(point)) && point.kind <= PointKind::kFilled;
}

}  // namespace

std::vector<TileEntry> point_tiles(const MapPackage& map) {
  std::vector<TileEntry> tiles = map.tiles();
  std::erase_if(tiles, [](const TileEntry& tile) { return tile.id.level != 0; });
  return tiles;
}

std::uint64_t count_chosen(ExportJob& job) {
  std::array<std::uint64_t, 4> kinds{};
  const std::vector<TileEntry> tiles = point_tiles(job.map);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const MapTile tile = job.map.tile(tiles[i].id);
    for (const MapPoint& point : tile) {
      if (!is_usable(tile, point, tiles[i].from_origin()))
        throw InputError(
            fmt::format("{}: tile {} {}", job.map.folder().string(), tiles[i].id.x, tiles[i].id.y),
            "a point outside its bounds or of no kind",
            "a package as it was published (`stillmap store verify`)");
      ++kinds.at(static_cast<std::size_t>(point.kind));
    }
    job.tell({0.0, 0.2}, i + 1, tiles.size());
  }
  std::uint64_t all = 0, chosen = 0;
  for (std::size_t kind = 0; kind < kinds.size(); ++kind) {
    all += kinds[kind];
    if (!job.takes(static_cast<PointKind>(kind))) kinds[kind] = 0;
    chosen += kinds[kind];
  }
  if (chosen == 0)
    throw InputError(job.map.folder().string(), "no point that is not left out",
                     "one or more: leave out fewer kinds (--without)");
  job.result.points = chosen;
  job.result.counts["ground"] = kinds[static_cast<std::size_t>(PointKind::kGround)];
  job.result.counts["projected"] = kinds[static_cast<std::size_t>(PointKind::kProjected)];
  job.result.counts["filled"] = kinds[static_cast<std::size_t>(PointKind::kFilled)];
  job.result.counts["left_out"] = all - chosen;
  return chosen;
}

void visit_chosen(const ExportJob& job,
                  const std::function<void(const MapTile&, const MapPoint&)>& visit) {
  const std::vector<TileEntry> tiles = point_tiles(job.map);
  for (std::size_t i = 0; i < tiles.size(); ++i) {
    const MapTile tile = job.map.tile(tiles[i].id);
    for (const MapPoint& point : tile)
      if (job.takes(point.kind)) visit(tile, point);
    job.tell({0.2, 1.0}, i + 1, tiles.size());
  }
}

}  // namespace stillmap::maps
