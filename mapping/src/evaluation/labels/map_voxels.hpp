#pragma once

#include "stacking/voxel_grid.hpp"

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Which voxels of a map hold a measured point. 16 to 32 bytes a voxel.
class MapVoxels {
 public:
  explicit MapVoxels(const maps::MapPackage& map);

  /// Whether the voxel that a point [m, map frame] lies in holds a measured point. A point within
  /// 1e-4 m of a side counts for both: means are rounded to float.
  [[nodiscard]] bool hold(const Eigen::Vector3d& p_map) const;

 private:
  void insert(const Eigen::Vector3d& p_map);
  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const;

  VoxelGrid grid_;
  std::size_t size_ = 0;
  /// Open addressing, 0 = free.
  std::vector<std::uint64_t> slots_;
};

}  // namespace stillmap::mapping
