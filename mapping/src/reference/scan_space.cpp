#include "reference/scan_space.hpp"

#include <fmt/format.h>

#include <stdexcept>

namespace stillmap::mapping::reference {

void ScanSpace::clear() {
  index_.clear();
  blocks_.clear();
}

ScanSpace::Block& ScanSpace::at(const Eigen::Vector3i& block, BlockIndex::Hint& hint) {
  const std::uint32_t number = index_.add(block, hint);
  if (number == blocks_.size()) blocks_.emplace_back();
  return blocks_[number];
}

const ScanSpace::Block* ScanSpace::find(const Eigen::Vector3i& block) const {
  const std::uint32_t number = index_.find(block);
  return number == BlockIndex::kNone ? nullptr : &blocks_[number];
}

Eigen::Vector3d in_voxels(const Eigen::Vector3d& p, double voxel_m, const char* what) {
  const double limit_m = voxel_m * 8.0 * BlockIndex::kLimit - 2.0 * kMaxRange_m;
  if (!(p.cwiseAbs().maxCoeff() <= limit_m)) {
    throw std::invalid_argument(fmt::format("{}: found [{}, {}, {}], expected within {} m of zero",
                                            what, p.x(), p.y(), p.z(), limit_m));
  }
  return p / voxel_m;
}

}  // namespace stillmap::mapping::reference
