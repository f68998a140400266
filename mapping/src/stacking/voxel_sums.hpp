#pragma once

#include <cstdint>

#include <stillmap/maps/cell_table.hpp>
#include <vector>

namespace stillmap::mapping {

/// What fell into one voxel. Measured and moved points of a voxel stay apart: a mean of both would
/// be at a place where nothing ever was.
struct VoxelSum {
  /// `VoxelGrid::Place::voxel`, then one bit for moved points.
  std::uint64_t key = 0;
  /// Of the offsets from the voxel's lower corner [m].
  float offset[3] = {};
  float intensity = 0.0F;
  std::uint32_t observations = 0;
  /// Of them, those that are ground.
  std::uint32_t ground = 0;
  /// Scans with a point in it, the first and the last of them by ordinal.
  std::uint32_t scans = 0, first_scan = 0, last_scan = 0;
  /// Number of the object that was seen last plus 1, for moved points.
  std::uint32_t object = 0;

  [[nodiscard]] std::uint64_t voxel() const { return key >> 1U; }
  [[nodiscard]] bool moved() const { return (key & 1U) != 0; }
  /// @param later  of the same key, from the same scan or later ones.
  void add(const VoxelSum& later, bool same_scan);
};

/// The voxels of one tile that hold something, found by their key.
class VoxelSums {
 public:
  /// Adds to the sum of the same key, or begins it.
  void add(const VoxelSum& sum, bool same_scan);

  [[nodiscard]] const std::vector<VoxelSum>& sums() const { return sums_; }

 private:
  std::vector<VoxelSum> sums_;
  maps::CellIndex index_;
};

}  // namespace stillmap::mapping
