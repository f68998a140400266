#include <stillmap/mapping/map_consistency.hpp>

#include "consistency/surface_cells.hpp"
#include "core/ordered_pipeline.hpp"
#include "core/share_of.hpp"

#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

namespace stillmap::mapping {
namespace {

nlohmann::ordered_json json_number(double value) {
  return std::isfinite(value) ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
}

nlohmann::ordered_json surface_json(const SurfaceThickness& surface) {
  return {{"thickness_median_m", json_number(surface.median_m)},
          {"thickness_p95_m", json_number(surface.p95_m)},
          {"planar_share", json_number(surface.planar_share())},
          {"planar_cells", surface.planar_cells},
          {"cells", surface.cells}};
}

}  // namespace

double SurfaceThickness::planar_share() const { return share_of(planar_cells, cells); }

MapConsistency map_consistency(const maps::MapPackage& map, int threads,
                               const ProgressCallback& progress, const CancelFlag& cancel) {
  std::vector<maps::TileId> tiles;
  for (const maps::TileEntry& tile : map.tiles()) {
    if (tile.id.level == 0) tiles.push_back(tile.id);
  }
  ConsistencySum sum;
  std::size_t done = 0;
  process_in_order(
      tiles.size(), threads,
      [&](std::size_t i) {
        ConsistencySum of_tile;
        of_tile.add(surface_cells(surface_points(tiles[i], map.tile(tiles[i])),
                                  map.manifest().voxel_size_m));
        return of_tile;
      },
      [&](const ConsistencySum& of_tile) {
        sum.add(of_tile);
        if (progress) progress("consistency", ++done, tiles.size());
      },
      cancel);
  return sum.result();
}

std::string to_json(const MapConsistency& consistency) {
  return nlohmann::ordered_json{{"mean_map_entropy", json_number(consistency.mean_map_entropy)},
                                {"entropy_points", consistency.entropy_points},
                                {"walls", surface_json(consistency.walls)},
                                {"ground", surface_json(consistency.ground)}}
      .dump(2);
}

}  // namespace stillmap::mapping
