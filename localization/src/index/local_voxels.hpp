#pragma once

#include "map_level.hpp"
#include "voxel_moments.hpp"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Binary logarithm of a tile's side in cells.
inline constexpr int kLocalTileShift = 7;

/// Voxels of one size that grow. The shape of a voxel is worked out anew only where points were
/// added.
class GrowingLevel {
 public:
  explicit GrowingLevel(double edge_m) : edge_m_(edge_m) {}

  /// Adds a scan's cells to those that are not full yet.
  void add(const MomentGrid& scan);
  /// Moves the grid's origin by so many cells, and forgets the cells whose centres are farther than
  /// `reach_m` from a place. @param place  [m] relative to the new origin.
  void move(const Eigen::Vector3i& cells, const Eigen::Vector3d& place, double reach_m);

  /// Valid until the next change.
  [[nodiscard]] MapIndex::Level view() const;
  [[nodiscard]] double edge_m() const { return edge_m_; }
  [[nodiscard]] std::size_t voxel_count() const { return voxels_.size(); }

 private:
  /// A cell with enough points to have a shape.
  struct Numbered {
    CellBlocks::Place place;
    /// In `grid_.cells`.
    std::uint32_t cell = 0;
  };
  /// Gives cells that have got a shape their numbers among the others.
  void insert(std::vector<Numbered> fresh);

  double edge_m_;
  MomentGrid grid_;
  /// Number of each cell's voxel, `VoxelTable::kNone` for a cell without shape.
  std::vector<std::uint32_t> numbers_;
  /// As numbered.
  std::vector<Numbered> order_;
  std::vector<Voxel> voxels_;
  CellBlockTable blocks_{{}, kLocalTileShift};
};

/// Levels of 2, 1 and 0.5 m around a moving sensor. Coordinates are relative to an origin that
/// follows it, so that floats keep their tenths of millimetres however far it goes.
class LocalVoxels {
 public:
  LocalVoxels();

  /// @param T_odom_lidar  finite. Points that are not finite or beyond `reach_m` are left out.
  void add(std::span<const Eigen::Vector3f> points_lidar, const Eigen::Isometry3d& T_odom_lidar,
           double reach_m);

  /// Coarse to fine; valid until the next `add`.
  [[nodiscard]] std::span<const MapIndex::Level> levels() const { return views_; }
  /// In the odom frame [m].
  [[nodiscard]] const Eigen::Vector3d& origin() const { return origin_; }

 private:
  void follow(const Eigen::Vector3d& sensor, double reach_m);

  /// Fine to coarse.
  std::vector<GrowingLevel> growing_;
  std::vector<MapIndex::Level> views_;
  Eigen::Vector3d origin_ = Eigen::Vector3d::Zero();
  /// Where the origin was last moved from.
  Eigen::Vector3d centre_ = Eigen::Vector3d::Zero();
  bool placed_ = false;
};

}  // namespace stillmap::localization
