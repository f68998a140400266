#pragma once

#include "stacking/voxel_grid.hpp"

#include <stillmap/maps/cell_table.hpp>
#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace stillmap::mapping {

/// Which voxels of a map hold a measured point. 12 to 24 bytes a voxel.
class MapVoxels {
 public:
  explicit MapVoxels(const maps::MapPackage& map);

  /// Whether the voxel that a point [m, map frame] lies in holds a measured point. A point within
  /// 1e-4 m of a side counts for both: means are rounded to float.
  [[nodiscard]] bool hold(const Eigen::Vector3d& p_map) const;

 private:
  void insert(const Eigen::Vector3d& p_map);
  [[nodiscard]] auto key_at() const {
    return [this](std::uint32_t number) { return keys_[number]; };
  }

  VoxelGrid grid_;
  std::vector<std::uint64_t> keys_;
  maps::CellIndex index_;
};

}  // namespace stillmap::mapping
