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
    : origin_(map.manifest().origin), voxel_m_(map.manifest().voxel_size_m) {
  for (const maps::TileEntry& tile : map.manifest().tiles) {
    for (const maps::MapPoint& point : map.tile(tile.id)) {
      if (!maps::is_measured(point.kind)) continue;
      const Eigen::Vector3f p(point.x, point.y, point.z);
      const Eigen::Array3d exact = p.cast<double>().array();
      points_.emplace(key_of((exact / kSearchCellM).floor()), p);
      voxels_.insert(key_of(((exact - kRoundingM) / voxel_m_).floor()));
      voxels_.insert(key_of(((exact + kRoundingM) / voxel_m_).floor()));
      voxels_.insert(key_of((exact / voxel_m_).floor()));
    }
  }
}

bool MeasuredPoints::in_voxel_of(const Eigen::Vector3d& p_map) const {
  return voxels_.contains(key_of(((p_map - origin_) / voxel_m_).array().floor()));
}

bool MeasuredPoints::within(const Eigen::Vector3d& p_map, double radius_m) const {
  const Eigen::Vector3d p = p_map - origin_;
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
