#pragma once

#include "views/posed_views.hpp"

#include <stillmap/maps/map_tile.hpp>
#include <stillmap/maps/tile_evidence.hpp>

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// What the drives of a build saw of tiles, as packages keep it. Safe from several threads.
///
/// One view every 8 m of each drive's way, and every 100 scans of a vehicle that stands, is asked
/// of what lies within 25 m of it: more views say little more of cubes of a metre. Views whose pose
/// is in doubt are not asked.
class SeenCubes {
 public:
  /// @param views  of all scans; outlives this. @param drive_of_scan  one a scan.
  SeenCubes(const PosedViews& views, std::span<const std::size_t> drive_of_scan);

  /// @param lowest_m  where the lowest cubes begin, local frame [m].
  [[nodiscard]] maps::TileEvidence of(maps::TileId tile, std::int32_t lowest_m) const;

 private:
  struct View {
    std::size_t drive = 0;
    std::size_t scan = 0;
  };
  const PosedViews& views_;
  /// By the tile that they stand in.
  std::map<maps::TileId, std::vector<View>> by_tile_;
};

}  // namespace stillmap::mapping
