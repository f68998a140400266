#pragma once

#include "index/index_bytes.hpp"
#include "index_grid.hpp"
#include "voxel_moments.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <filesystem>
#include <limits>
#include <map>
#include <string>
#include <vector>

namespace stillmap::localization {

/// Makes the voxels of one region from its points, block by block: sums of cells are twice as large
/// as voxels, and there are more of them, so they are in memory for one block only. The voxels of
/// each block are a sorted run.
class RegionBuilder {
 public:
  /// Blocks of a region are this wide [m]; cells of the coarsest level divide it.
  static constexpr double kBlockM = 160.0;

  static_assert(kRegionM == 4 * kBlockM);

  /// @param lowest_m  of all points, above the index's origin [m].
  /// @param scratch  folder for the voxels, as of `maps::ScratchPieces`.
  /// @throws maps::InputError beyond `kFarthestRegionM`.
  RegionBuilder(const MapIndexOptions& options, double lowest_m,
                const std::filesystem::path& scratch);

  /// Points from here on belong to a block. @param x, y  its place in the region.
  void begin_block(int x, int y);
  /// In an order that does not depend on where the map's origin lies.
  /// @param p  x, y from the region's corner, z above the index's origin [m], finite.
  /// @throws maps::InputError for one outside of the block, or below the lowest.
  void add(const Eigen::Vector3d& p, double weight);
  [[nodiscard]] RegionContent content() &&;

 private:
  /// Makes voxels of the block's cells.
  void end_block();
  [[nodiscard]] int cells_of_block() const;

  MapIndexOptions options_;
  std::int32_t floor_;
  /// Cells of the finest level at the block's lower corner.
  Eigen::Array2i first_ = Eigen::Array2i::Zero();
  /// Of the block, at the finest level: x, y counted from the region's corner, z from
  /// `kCellsPerAxis` / 2 below the origin.
  MomentGrid grid_;
  /// Of the blocks before.
  VoxelRuns voxels_;
};

/// The tiles of a map by region, and how they become voxels.
class MapRegions {
 public:
  /// @param map  outlives this.
  MapRegions(const maps::MapPackage& map, const MapIndexOptions& options);

  /// By x, then y.
  [[nodiscard]] std::vector<maps::RegionId> regions() const;
  /// Digest of what a region's voxels depend on: its tiles.
  [[nodiscard]] std::string source_of(maps::RegionId region) const;
  /// @param region  one of `regions()`. @param scratch  as of `RegionBuilder`.
  /// @throws maps::InputError for a tile that is damaged or holds a coordinate that is not finite,
  /// maps::StorageError for `scratch`.
  [[nodiscard]] RegionContent build(maps::RegionId region,
                                    const std::filesystem::path& scratch) const;

 private:
  const maps::MapPackage& map_;
  MapIndexOptions options_;
  struct RegionTiles {
    /// By x, then y.
    std::vector<maps::TileId> tiles;
    /// Of their points, above the map's origin [m].
    double lowest_m = std::numeric_limits<double>::infinity();
  };
  std::map<maps::RegionId, RegionTiles> tiles_;
};

/// Voxels of points [m], relative to the index's origin, by region. @throws std::invalid_argument
/// if one is not finite, maps::InputError beyond `kFarthestRegionM`.
[[nodiscard]] std::map<maps::RegionId, RegionContent> build_regions(
    const std::vector<Eigen::Vector3d>& points, const MapIndexOptions& options);

}  // namespace stillmap::localization
