#pragma once

#include "reference/block_grid.hpp"
#include "reference/voxel_ray.hpp"

#include <stillmap/mapping/cleaning.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stillmap::mapping::reference {

/// The voxels that the rays of one scan met. To be cleared and used again, so that its memory is
/// asked for once.
class ScanSpace {
 public:
  struct Block {
    /// Passed by a ray.
    BlockBits free{};
    /// Holds a surface.
    BlockBits hit{};
    /// Holds the end of a ray.
    BlockBits end{};
  };

  void clear();
  /// Makes the block when it is not there.
  [[nodiscard]] Block& at(const Eigen::Vector3i& block, BlockIndex::Hint& hint);
  /// @return null for a block that no ray met.
  [[nodiscard]] const Block* find(const Eigen::Vector3i& block) const;

  [[nodiscard]] std::size_t size() const { return index_.size(); }
  [[nodiscard]] const Eigen::Vector3i& position(std::size_t number) const {
    return index_.block(number);
  }
  [[nodiscard]] const Block& block(std::size_t number) const { return blocks_[number]; }

 private:
  BlockIndex index_;
  std::vector<Block> blocks_;
};

/// A voxel of a ScanSpace that moves from neighbour to neighbour.
class ScanCursor {
 public:
  ScanCursor(ScanSpace& space, const Eigen::Vector3i& voxel) : space_(&space) { move_to(voxel); }

  /// To any voxel.
  void move_to(const Eigen::Vector3i& voxel) {
    corner_ = block_of(voxel);
    place_ =
        kInside + (voxel.x() & 7) + ((voxel.y() & 7) << kBits) + ((voxel.z() & 7) << (2 * kBits));
    block_ = &space_->at(corner_, hint_);
  }
  /// To the neighbour on one axis. @param sign  -1 or 1.
  void step(int axis, int sign) {
    place_ += sign * (1 << (kBits * axis));
    if ((place_ & kInside) != kInside) enter_next();
  }

  [[nodiscard]] bool is_hit() const { return (block_->hit[word()] & bit()) != 0; }
  void set_free() { block_->free[word()] |= bit(); }
  void set_hit() { block_->hit[word()] |= bit(); }
  /// @return whether it was not set before.
  bool set_end() {
    const bool is_new = (block_->end[word()] & bit()) == 0;
    block_->end[word()] |= bit();
    return is_new;
  }

 private:
  /// Five bits an axis, 8 to 15 within the block, so that one look at the bits of value 8 tells
  /// when a step has left it.
  static constexpr int kBits = 5;
  static constexpr int kInside = 8 + (8 << kBits) + (8 << (2 * kBits));

  void enter_next() {
    for (int axis = 0; axis < 3; ++axis) {
      const int at = (place_ >> (kBits * axis)) & 31;
      const int by = (at >> 3) - 1;
      corner_[axis] += by;
      place_ -= (8 * by) << (kBits * axis);
    }
    block_ = &space_->at(corner_, hint_);
  }
  [[nodiscard]] std::size_t word() const {
    return static_cast<std::size_t>((place_ >> (2 * kBits)) & 7);
  }
  [[nodiscard]] std::uint64_t bit() const {
    return std::uint64_t{1} << ((place_ & 7) | ((place_ >> (kBits - 3)) & 56));
  }

  ScanSpace* space_;
  Eigen::Vector3i corner_;
  BlockIndex::Hint hint_;
  ScanSpace::Block* block_ = nullptr;
  int place_ = 0;
};

/// The middle of a voxel.
[[nodiscard]] inline Eigen::Vector3d middle_of(const Eigen::Vector3i& voxel) {
  return voxel.cast<double>() + Eigen::Vector3d::Constant(0.5);
}

/// A scan in voxel edges.
struct ScanRays {
  Eigen::Vector3d sensor = Eigen::Vector3d::Zero();
  /// Voxels with the end of a ray, each once.
  std::vector<Eigen::Vector3i> ends;
};

/// Farther points give no ray: a single one of a broken scan would cost more than a whole drive.
inline constexpr double kMaxRangeM = 500.0;

/// Takes the points of a scan that `keep` (point number) names; each voxel of ends counts once, as
/// in "down-sampling method: center" of DUFOMap and "discretize" of OctoMap.
///
/// @param space  its `end` marks are set.
/// @throws std::invalid_argument when the pose is not finite or too far off for the voxels.
template <typename Keep>
void take_rays(const PosedScan& scan, double voxel_m, ScanSpace& space, const Keep& keep,
               ScanRays& rays);

/// @throws std::invalid_argument when a position is not finite or beyond 2^26 voxels, less the
/// range of a ray, from zero.
[[nodiscard]] Eigen::Vector3d in_voxels(const Eigen::Vector3d& p, double voxel_m, const char* what);

/// Marks the voxels on the last `hit_voxels` (voxel edges, >= 0) of each ray as hit.
void mark_hits(const ScanRays& rays, double hit_voxels, ScanSpace& space);

/// Marks the voxels from the sensor to each ray's end as free, the end not included.
void mark_passed(const ScanRays& rays, ScanSpace& space);

template <typename Keep>
void take_rays(const PosedScan& scan, double voxel_m, ScanSpace& space, const Keep& keep,
               ScanRays& rays) {
  rays.sensor = in_voxels(scan.T_local_lidar.translation(), voxel_m, "sensor");
  rays.ends.clear();
  const Eigen::Matrix3d R = scan.T_local_lidar.linear() / voxel_m;
  ScanCursor cursor(space, voxel_of(rays.sensor));
  for (std::size_t i = 0; i < scan.positions.size(); ++i) {
    const Eigen::Vector3d p = scan.positions[i].cast<double>();
    if (!keep(i) || !(p.squaredNorm() <= kMaxRangeM * kMaxRangeM)) continue;
    const Eigen::Vector3i voxel = voxel_of(rays.sensor + R * p);
    cursor.move_to(voxel);
    if (cursor.set_end()) rays.ends.push_back(voxel);
  }
}

}  // namespace stillmap::mapping::reference
