#include "evaluation/measured_points.hpp"

#include <array>
#include <cmath>

namespace stillmap::mapping {
namespace {

/// Edge of the cells that neighbours are searched in: the largest radius that may be asked for [m].
constexpr double kSearchCellM = 0.1;
/// A mean this near to a side of its voxel may lie beyond it after rounding to float [m].
constexpr double kRoundingM = 1e-4;

std::uint64_t key_of(const Eigen::Array3d& cell) {
  constexpr std::int64_t kHalf = 1 << 20;
  std::uint64_t key = 0;
  for (Eigen::Index axis = 0; axis < 3; ++axis)
    key = (key << 21U) |
          (static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[axis]) + kHalf) & 0x1FFFFFU);
  return key;
}

}  // namespace

MeasuredPoints::MeasuredPoints(const maps::MapPackage& map)
    : grid_(map.manifest().origin, map.manifest().voxel_size_m) {
  for (const maps::TileEntry& tile : map.manifest().tiles) {
    for (const maps::MapPoint& point : map.tile(tile.id)) {
      if (!maps::is_measured(point.kind)) continue;
      const Eigen::Vector3f p(point.x, point.y, point.z);
      points_.emplace(key_of((p.cast<double>() / kSearchCellM).array().floor()), p);
      add_voxels(p.cast<double>());
    }
  }
}

void MeasuredPoints::add_voxels(const Eigen::Vector3d& p_local) {
  // Each axis may have been rounded its own way. Most points are far from every side: one voxel.
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d side((corner & 1) != 0 ? 1 : -1, (corner & 2) != 0 ? 1 : -1,
                               (corner & 4) != 0 ? 1 : -1);
    const auto place = grid_.find(grid_.origin() + p_local + kRoundingM * side);
    if (place) voxels_[place->tile].insert(place->voxel);
  }
}

bool MeasuredPoints::in_voxel_of(const Eigen::Vector3d& p_map) const {
  const auto place = grid_.find(p_map);
  if (!place) return false;
  const auto tile = voxels_.find(place->tile);
  return tile != voxels_.end() && tile->second.contains(place->voxel);
}

bool MeasuredPoints::within(const Eigen::Vector3d& p_map, double radius_m) const {
  const Eigen::Vector3d p = p_map - grid_.origin();
  const Eigen::Array3d centre = (p / kSearchCellM).array().floor();
  for (int step = 0; step < 27; ++step) {
    const Eigen::Array3d offset(step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1);
    const auto [begin, end] = points_.equal_range(key_of(centre + offset));
    for (auto it = begin; it != end; ++it) {
      if ((it->second.cast<double>() - p).norm() <= radius_m) return true;
    }
  }
  return false;
}

}  // namespace stillmap::mapping
