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
  const double limit_m = voxel_m * 8.0 * BlockIndex::kLimit - 2.0 * kMaxRangeM;
  if (!(p.cwiseAbs().maxCoeff() <= limit_m)) {
    throw std::invalid_argument(fmt::format("{}: found [{}, {}, {}], expected within {} m of zero",
                                            what, p.x(), p.y(), p.z(), limit_m));
  }
  return p / voxel_m;
}

void mark_hits(const ScanRays& rays, double hit_voxels, ScanSpace& space) {
  for (const Eigen::Vector3i& end : rays.ends) {
    const Eigen::Vector3d goal = middle_of(end);
    const double range = (goal - rays.sensor).norm();
    const Eigen::Vector3d from =
        range > hit_voxels ? Eigen::Vector3d(goal + (rays.sensor - goal) * (hit_voxels / range))
                           : rays.sensor;
    VoxelRay ray(from, goal);
    ScanCursor cursor(space, voxel_of(from));
    cursor.set_hit();
    for (int left = ray.steps(); left > 0; --left) {
      const int axis = ray.advance();
      cursor.step(axis, ray.sign(axis));
      cursor.set_hit();
    }
  }
}

void mark_passed(const ScanRays& rays, ScanSpace& space) {
  for (const Eigen::Vector3i& end : rays.ends) {
    VoxelRay ray(rays.sensor, middle_of(end));
    ScanCursor cursor(space, voxel_of(rays.sensor));
    for (int left = ray.steps(); left > 0; --left) {
      cursor.set_free();
      const int axis = ray.advance();
      cursor.step(axis, ray.sign(axis));
    }
  }
}

}  // namespace stillmap::mapping::reference
