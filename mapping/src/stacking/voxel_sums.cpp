#include "stacking/voxel_sums.hpp"

#include <algorithm>
#include <utility>

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

std::size_t VoxelSums::slot_of(std::uint64_t key) const {
  // SplitMix64's finisher: neighbouring voxels must not crowd.
  std::uint64_t mixed = key * 0x9E3779B97F4A7C15ULL;
  mixed ^= mixed >> 29U;
  std::size_t slot = mixed & (slots_.size() - 1);
  while (slots_[slot] != 0 && sums_[slots_[slot] - 1].key != key)
    slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

void VoxelSums::grow() {
  slots_.assign(std::max<std::size_t>(64, 2 * slots_.size()), 0);
  for (std::size_t i = 0; i < sums_.size(); ++i)
    slots_[slot_of(sums_[i].key)] = static_cast<std::uint32_t>(i + 1);
}

void VoxelSums::add(const VoxelSum& sum, bool same_scan) {
  if (2 * sums_.size() >= slots_.size()) grow();
  std::uint32_t& slot = slots_[slot_of(sum.key)];
  if (slot != 0) {
    sums_[slot - 1].add(sum, same_scan);
    return;
  }
  sums_.push_back(sum);
  slot = static_cast<std::uint32_t>(sums_.size());
}

std::vector<VoxelSum> VoxelSums::take_sorted() {
  slots_.clear();
  std::vector<VoxelSum> sums = std::exchange(sums_, {});
  std::sort(sums.begin(), sums.end(),
            [](const VoxelSum& a, const VoxelSum& b) { return a.key < b.key; });
  return sums;
}

}  // namespace stillmap::mapping
