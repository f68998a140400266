#pragma once

#include "consistency/surface_cells.hpp"
#include "core/top_view.hpp"
#include "pipeline/tile_work.hpp"

#include <stillmap/maps/map_tile.hpp>

#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// Tiles on their way into the package, with what is said of all of them.
class MapOfTiles {
 public:
  /// @param ids  of all tiles. @throws maps::InputError when there are none.
  MapOfTiles(Build& build, const std::vector<maps::TileId>& ids);

  /// In the order of `regions_of`.
  void take(const FinishedTile& finished);
  /// Writes the picture. Once, at the end.
  void finish();

 private:
  Build& build_;
  TopView preview_;
  std::size_t tiles_;
  std::size_t taken_ = 0;
  ConsistencySum consistency_;
};

}  // namespace stillmap::mapping
