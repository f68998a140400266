#pragma once

#include <Eigen/Core>

#include <stillmap/maps/cell_table.hpp>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

namespace stillmap::mapping {

/// Means of the points in each voxel of a grid, from a stream of points. Some 32 bytes a voxel. The
/// means depend on the order of the points only within rounding.
class VoxelMeans {
 public:
  /// @param edge_m  of a voxel, > 0. @throws std::invalid_argument when not.
  explicit VoxelMeans(double edge_m);

  /// @param position  finite, within 2^20 voxels of the origin [m].
  void add(const Eigen::Vector3f& position);

  [[nodiscard]] std::size_t size() const { return sums_.size(); }
  /// One a voxel, in the order in which voxels were met; ends the collection.
  [[nodiscard]] std::vector<Eigen::Vector3f> take();

 private:
  struct Sum {
    std::uint64_t key = 0;
    /// Of the offsets from the voxel's lower corner [m], so that floats hold.
    Eigen::Vector3f offset = Eigen::Vector3f::Zero();
    std::uint32_t points = 0;
  };

  double edge_m_;
  double inverse_edge_;
  /// Not a vector: growing must not hold all of them twice.
  std::deque<Sum> sums_;
  maps::CellIndex index_;
};

}  // namespace stillmap::mapping
