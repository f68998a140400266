#pragma once

#include "core/point_cells.hpp"

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace stillmap::mapping {

/// The points of a package, to look truth points up in. Positions count from the map's origin [m].
/// Some 30 bytes a point.
class ThinnedMap {
 public:
  explicit ThinnedMap(const maps::MapPackage& map);

  /// What a truth point meets, as bits of `RemovedPoints::Met`.
  [[nodiscard]] unsigned met(const Eigen::Vector3f& p) const;
  /// Where a point that was projected landed: straight below it, at the height of the projected
  /// point that the package has there. Nothing when it has none.
  [[nodiscard]] std::optional<Eigen::Vector3f> landing_of(const Eigen::Vector3f& p) const;

 private:
  struct Parts;
  explicit ThinnedMap(Parts parts);
  [[nodiscard]] static Parts parts_of(const maps::MapPackage& map);

  double voxel_size_m_;
  PointCells measured_;
  /// Projected and filled.
  PointCells moved_;
  /// Projected, at height 0, and their heights.
  PointCells projected_;
  std::vector<float> projected_heights_;
};

/// Every point of a package, from its origin [m].
template <typename Visit>
void for_each_point(const maps::MapPackage& map, const Visit& visit) {
  for (const maps::TileEntry& entry : map.tiles()) {
    const maps::MapTile tile = map.tile(entry.id);
    for (const maps::MapPoint& point : tile)
      visit(Eigen::Vector3f(tile.from_origin(point).cast<float>()), point.kind);
  }
}

}  // namespace stillmap::mapping
