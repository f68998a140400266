#pragma once

#include "index/index_bytes.hpp"
#include "voxel_moments.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Core>

#include <map>
#include <string>
#include <vector>

namespace stillmap::localization {

/// Makes the voxels of one region from its points and from those around it, which its place grids
/// look at. Points come in an order that does not depend on where the map's origin lies.
class RegionBuilder {
 public:
  explicit RegionBuilder(const MapIndexOptions& options);

  /// Points farther than this outside a region change nothing in it [m]: whole cells of the
  /// coarsest level.
  [[nodiscard]] static double rim_m(const MapIndexOptions& options);

  /// @param p  x, y from the region's corner, z above the index's origin [m], finite.
  void add(const Eigen::Vector3d& p, double weight);
  [[nodiscard]] RegionContent content() const;

 private:
  MapIndexOptions options_;
  double rim_m_;
  /// Of the finest level: x, y counted from the rim, z from `kCellsPerAxis` / 2 below the origin.
  MomentGrid grid_;
};

/// The tiles of a map by region, and how they become voxels.
class MapRegions {
 public:
  /// @param map  outlives this.
  MapRegions(const maps::MapPackage& map, const MapIndexOptions& options);

  /// By x, then y.
  [[nodiscard]] std::vector<maps::RegionId> regions() const;
  /// Digest of what a region's voxels depend on: its tiles and those that touch it.
  [[nodiscard]] std::string source_of(maps::RegionId region) const;
  /// @throws maps::InputError for a tile that is damaged or holds a coordinate that is not finite.
  [[nodiscard]] RegionContent build(maps::RegionId region) const;

 private:
  /// Of the region, and those of its neighbours that touch it; in an order that tells nothing of
  /// other regions.
  [[nodiscard]] std::vector<maps::TileId> tiles_around(maps::RegionId region) const;

  const maps::MapPackage& map_;
  MapIndexOptions options_;
  std::map<maps::RegionId, std::vector<maps::TileId>> tiles_;
};

/// Voxels of points [m], relative to the index's origin, by region. @throws std::invalid_argument
/// if one is not finite, maps::InputError beyond `kFarthestRegionM`.
[[nodiscard]] std::map<maps::RegionId, RegionContent> build_regions(
    const std::vector<Eigen::Vector3d>& points, const MapIndexOptions& options);

}  // namespace stillmap::localization
