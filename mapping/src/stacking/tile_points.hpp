#pragma once

#include "stacking/voxel_grid.hpp"
#include "stacking/voxel_sums.hpp"

#include <stillmap/mapping/cleaning.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <functional>
#include <vector>

namespace stillmap::mapping {

/// A finished tile, as the package holds it.
struct TilePoints {
  maps::TileId id;
  /// x, y from the tile's corner, z from the map's origin [m].
  std::vector<maps::MapPoint> points;
  std::vector<maps::PointHistory> history;

  /// @param origin  of the map.
  [[nodiscard]] maps::MapTile placed(const Eigen::Vector3d& origin) const;
};
/// The mean of a voxel, from the map's origin [m].
[[nodiscard]] Eigen::Vector3d mean_of(const VoxelGrid& grid, maps::TileId tile,
                                      const VoxelSum& sum);
/// Whether most of what a voxel saw is ground.
[[nodiscard]] inline bool is_ground(const VoxelSum& sum) {
  return 2 * sum.ground > sum.observations;
}

/// The measured ones of a tile's voxels, for cleaning.
/// @param numbers  gets the number of each in `sums`.
[[nodiscard]] CleaningPoints cleaning_points(const VoxelGrid& grid, maps::TileId tile,
                                             const std::vector<VoxelSum>& sums,
                                             std::vector<std::size_t>& numbers);

/// Turns the voxels of a tile into points: means, kinds, normals, who saw them when. Coordinates
/// are put into the steps of the package here (`maps/tile_steps.hpp`), so that whoever reads a map
/// sees the same values.
/// @param lidar_of_scan  where the sensor was at a scan, from the map's origin [m].
[[nodiscard]] TilePoints to_points(
    const VoxelGrid& grid, maps::TileId tile, const std::vector<VoxelSum>& sums,
    const std::function<Eigen::Vector3f(std::uint32_t scan)>& lidar_of_scan);

/// Adds a point of synthetic ground, in steps as above. @param object  number of the object that
/// stood there plus 1.
void add_filled(const Eigen::Vector3d& filled, std::uint32_t object, TilePoints& tile);

}  // namespace stillmap::mapping
