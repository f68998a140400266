#pragma once

#include "cell_bits.hpp"
#include "index/index_file.hpp"
#include "map_level.hpp"

#include <stillmap/localization/map_index.hpp>
#include <stillmap/maps/region.hpp>

#include <Eigen/Core>

#include <memory>
#include <mutex>
#include <utility>
#include <vector>

namespace stillmap::localization {

/// A region and the eight around it, as a query in that region sees the map: all numbers count from
/// the region's corner, so that they are as short wherever the region lies. It reaches 640 m from
/// any place in the region. Immutable, safe from several threads.
class IndexWindow {
 public:
  using Regions = std::vector<std::pair<maps::RegionId, std::shared_ptr<const OpenRegion>>>;

  /// @param origin_map  of the index, in the map frame. @param regions  those of the nine that
  /// there are.
  IndexWindow(const Eigen::Vector3d& origin_map, maps::RegionId middle, Regions regions,
              const MapIndexOptions& options);

  /// Where coordinates count from, in the map frame [m].
  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }
  /// Coarse to fine.
  [[nodiscard]] const std::vector<MapIndex::Level>& levels() const { return levels_; }
  /// Occupied columns for the search without a prior, from wide to fine; made when they are first
  /// asked for.
  [[nodiscard]] const std::vector<CellBits>& place_grids() const;

  [[nodiscard]] Eigen::Isometry3d from_map(Eigen::Isometry3d T_map_lidar) const {
    T_map_lidar.translation() -= origin_;
    return T_map_lidar;
  }
  [[nodiscard]] Eigen::Isometry3d to_map(Eigen::Isometry3d T_window_lidar) const {
    T_window_lidar.translation() += origin_;
    return T_window_lidar;
  }

 private:
  /// Keeps the bytes that the levels and grids look into.
  Regions regions_;
  maps::RegionId middle_;
  Eigen::Vector3d origin_;
  std::vector<MapIndex::Level> levels_;
  mutable std::once_flag grids_made_;
  mutable std::vector<CellBits> place_grids_;
};

}  // namespace stillmap::localization
