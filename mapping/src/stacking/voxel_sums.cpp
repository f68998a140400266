#include "stacking/voxel_sums.hpp"

namespace stillmap::mapping {

void VoxelSum::add(const VoxelSum& later, bool same_scan) {
  for (int axis = 0; axis < 3; ++axis) offset[axis] += later.offset[axis];
  intensity += later.intensity;
  observations += later.observations;
  ground += later.ground;
  if (!same_scan) scans += later.scans;
  last_scan = later.last_scan;
  if (later.object != 0) object = later.object;
}

void VoxelSums::add(const VoxelSum& sum, bool same_scan) {
  const auto [number, is_new] =
      index_.insert(sum.key, [this](std::uint32_t of) { return sums_[of].key; });
  if (is_new) {
    sums_.push_back(sum);
  } else {
    sums_[number].add(sum, same_scan);
  }
}

}  // namespace stillmap::mapping
