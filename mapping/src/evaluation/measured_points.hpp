#pragma once

#include "stacking/voxel_grid.hpp"

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <unordered_map>
#include <unordered_set>
#include <vector>

namespace stillmap::mapping {

/// The measured points of a map, to look raw points up in.
class MeasuredPoints {
 public:
  explicit MeasuredPoints(const maps::MapPackage& map);

  /// Whether the voxel of the map that a point [m, map frame] lies in holds a measured point.
  [[nodiscard]] bool in_voxel_of(const Eigen::Vector3d& p_map) const;
  /// Whether a measured point lies within `radius_m` <= 0.1 m.
  [[nodiscard]] bool within(const Eigen::Vector3d& p_map, double radius_m) const;

 private:
  /// The voxel of a map point [m, from the origin], and those it may have been rounded out of.
  void add_voxels(const Eigen::Vector3d& p_local);

  VoxelGrid grid_;
  std::map<maps::TileId, std::unordered_set<std::uint64_t>> voxels_;
  std::unordered_multimap<std::uint64_t, Eigen::Vector3f> points_;
};

}  // namespace stillmap::mapping
