#pragma once

#include "stacking/tile_points.hpp"
#include "stacking/tile_stack.hpp"
#include "stacking/voxel_grid.hpp"

#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <utility>
#include <vector>

namespace stillmap::mapping {

/// A tile from the stack, not yet finished.
struct OpenTile {
  std::vector<VoxelSum> sums;
  /// Means of the measured ones.
  CleaningPoints points;
  /// Number of each of them in `sums`.
  std::vector<std::size_t> numbers;
};

/// Three columns of tiles of equal x at a time, so that a tile can be looked at with what lies
/// around it while memory does not grow with the map.
class TileWindow {
 public:
  /// @param tiles  of a region and of the rim of one tile around it, in order.
  /// @param kept   of these, those that stay on the stack; the others are taken off it.
  TileWindow(TileStack& stack, const VoxelGrid& grid, std::vector<maps::TileId> tiles,
             std::set<maps::TileId> kept)
      : stack_(stack), grid_(grid), tiles_(std::move(tiles)), kept_(std::move(kept)) {}

  /// Reads the columns x - 1 to x + 1, and lets go of those before. @param x  rises from call to
  /// call. @throws maps::StorageError.
  void move_to(std::int32_t x, int threads);

  /// Its own to use up; `points` of a tile stay for its neighbours.
  [[nodiscard]] OpenTile& tile(maps::TileId id) { return open_.at(id); }
  /// The points of a tile first, then those of its neighbours within `rim_m` <= 20 m of it.
  [[nodiscard]] CleaningPoints with_rim(maps::TileId id, double rim_m) const;

 private:
  TileStack& stack_;
  const VoxelGrid& grid_;
  std::vector<maps::TileId> tiles_;
  std::set<maps::TileId> kept_;
  /// Those that were read or are to be passed over.
  std::size_t passed_ = 0;
  std::map<maps::TileId, OpenTile> open_;
};

/// x and y of a tile [m].
[[nodiscard]] Eigen::AlignedBox2f area_of(maps::TileId id);

}  // namespace stillmap::mapping
