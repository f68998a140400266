#pragma once

#include "consistency/surface_cells.hpp"
#include "core/stage_timer.hpp"
#include "pipeline/build.hpp"
#include "stacking/tile_points.hpp"
#include "stacking/tile_stack.hpp"

#include <stillmap/maps/map_tile.hpp>
#include <stillmap/maps/region.hpp>
#include <stillmap/maps/tile_evidence.hpp>

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <vector>

namespace stillmap::mapping {

struct FinishedTile {
  TilePoints tile;
  maps::TileEvidence evidence;
  Counts counts;
  StageSeconds stage_seconds;
  ConsistencySum consistency;
};

/// What a method that needs the whole map at once says, tile by tile.
using MovedPoints = std::map<maps::TileId, std::vector<std::uint8_t>>;

/// The tiles of a region: they can be finished knowing those that touch them, and no others.
struct RegionTiles {
  std::vector<maps::TileId> own;
  /// These and those that touch them, in order.
  std::vector<maps::TileId> with_rim;
  /// Of these, those that other regions need, too.
  std::set<maps::TileId> shared;
};

/// By x, then y of the region. @param ids  in order.
[[nodiscard]] std::vector<RegionTiles> regions_of(const std::vector<maps::TileId>& ids);

/// Cleans and finishes the tiles of regions, one region after the other, several tiles at once.
/// @param stack  holds them and those that touch them; most are taken off it.
/// @param moved  of all tiles; null: ours or none.
/// @param take   gets them in order.
void finish_regions(const Build& build, const std::vector<RegionTiles>& regions, TileStack& stack,
                    const MovedPoints* moved, const std::function<void(const FinishedTile&)>& take);

}  // namespace stillmap::mapping
