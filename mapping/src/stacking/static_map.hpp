#pragma once

#include <stillmap/maps/map_package.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <unordered_map>
#include <vector>

namespace stillmap::mapping {

/// One point on its way into the map.
struct StackedPoint {
  Eigen::Vector3d p_map = Eigen::Vector3d::Zero();
  float intensity = 0.0F;
  maps::PointKind kind = maps::PointKind::kMeasured;
  /// As `maps::MapPoint::object`.
  std::uint8_t object = 0;
};

/// Merges points into voxels; a map point is the mean of what fell into its voxel.
///
/// Measured and moved points of one voxel stay apart, so that a mean is never taken of both: a
/// voxel gives up to two map points. Of the measured ones the majority says whether it is ground.
/// The result depends on the order of `add`, not on threads.
class StaticMap {
 public:
  /// @param origin        subtracted before points become floats [m].
  /// @param voxel_size_m  edge of a voxel, > 0.
  StaticMap(const Eigen::Vector3d& origin, double voxel_size_m);

  /// @return false for a point beyond 2^20 voxels from the origin, which is left out.
  bool add(const StackedPoint& point);

  [[nodiscard]] std::size_t size() const { return cells_.size(); }

  /// All points by tile of level 0, sorted by voxel within a tile.
  [[nodiscard]] std::map<maps::TileId, std::vector<maps::MapPoint>> tiles() const;

 private:
  struct Cell {
    std::uint64_t key = 0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double intensity_sum = 0.0;
    std::uint32_t observations = 0;
    std::uint32_t ground_observations = 0;
    maps::PointKind kind = maps::PointKind::kMeasured;
    std::uint8_t object = 0;
  };
  [[nodiscard]] static maps::MapPoint to_point(const Cell& cell);

  Eigen::Vector3d origin_;
  double inverse_voxel_;
  std::unordered_map<std::uint64_t, std::uint32_t> index_;
  std::vector<Cell> cells_;
};

}  // namespace stillmap::mapping
