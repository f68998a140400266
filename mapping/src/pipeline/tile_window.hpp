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
#include <vector>

namespace stillmap::mapping {

/// A tile taken off the stack, not yet finished.
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
  TileWindow(TileStack& stack, const VoxelGrid& grid) : stack_(stack), grid_(grid) {}

  /// Takes the columns x - 1 to x + 1 off the stack, and lets go of those before.
  /// @throws maps::StorageError.
  void move_to(std::int32_t x, int threads);

  /// Its own to use up; `points` of a tile stay for its neighbours.
  [[nodiscard]] OpenTile& tile(maps::TileId id) { return open_.at(id); }
  /// The points of a tile first, then those of its neighbours within `rim_m` <= 20 m of it.
  [[nodiscard]] CleaningPoints with_rim(maps::TileId id, double rim_m) const;

 private:
  TileStack& stack_;
  const VoxelGrid& grid_;
  std::map<maps::TileId, OpenTile> open_;
  std::map<std::int32_t, bool> taken_;
};

/// x and y of a tile [m].
[[nodiscard]] Eigen::AlignedBox2f area_of(maps::TileId id);

}  // namespace stillmap::mapping
