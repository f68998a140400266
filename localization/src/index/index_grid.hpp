#pragma once

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Core>

#include <cmath>
#include <cstddef>

/// The grid of an index: regions of 640 m from the index's origin on, whose cells divide them
/// evenly, so that no cell knows of another region's points. Level 0 is the coarsest.
namespace stillmap::localization {

/// Regions of an index begin at multiples of this along all axes, relative to its origin [m].
inline constexpr double kRegionM = maps::kRegionSizeM;

/// The index of a package begins so far below the map's origin: ground at height 0 lies in the
/// middle of the finest cells then, not on the border of two, which would share its points [m].
[[nodiscard]] inline double below_origin_m(const MapIndexOptions& options) {
  return 0.5 * options.finest_voxel_m;
}

[[nodiscard]] inline double edge_of_level(const MapIndexOptions& options, std::size_t level) {
  return std::ldexp(options.finest_voxel_m, options.levels - 1 - static_cast<int>(level));
}

/// Cells of a region along one axis, a multiple of 4.
[[nodiscard]] inline int cells_of_region(double edge_m) {
  return static_cast<int>(std::lround(kRegionM / edge_m));
}

/// Binary logarithm of the side of a tile of `CellBlocks`: the largest in [2, 7] that divides a
/// region.
[[nodiscard]] inline int tile_shift_of(double edge_m) {
  int shift = 7;
  while (cells_of_region(edge_m) % (1 << shift) != 0) --shift;
  return shift;
}

/// South-western corner of a region, relative to the index's origin [m].
[[nodiscard]] inline Eigen::Vector2d corner_of(maps::RegionId region) {
  return kRegionM * Eigen::Vector2d(region.x, region.y);
}

/// Beyond this [m] from the index's origin there is no region.
inline constexpr double kFarthestRegionM = 1e9;

/// @param x_m  relative to the index's origin, nearer than `kFarthestRegionM`.
[[nodiscard]] inline maps::RegionId region_at(double x_m, double y_m) {
  const auto along = [](double at) { return static_cast<std::int32_t>(std::floor(at / kRegionM)); };
  return {along(x_m), along(y_m)};
}

}  // namespace stillmap::localization
