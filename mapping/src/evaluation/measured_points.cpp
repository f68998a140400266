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
    : origin_(map.manifest().origin), inverse_voxel_(1.0 / map.manifest().voxel_size_m) {
  for (const maps::TileEntry& tile : map.manifest().tiles) {
    for (const maps::MapPoint& point : map.tile(tile.id)) {
      if (!maps::is_measured(point.kind)) continue;
      const Eigen::Vector3f p(point.x, point.y, point.z);
      const Eigen::Array3d exact = p.cast<double>().array();
      points_.emplace(key_of((exact / kSearchCellM).floor()), p);
      add_voxels(exact);
    }
  }
}

void MeasuredPoints::add_voxels(const Eigen::Array3d& exact) {
  const Eigen::Array3d low = ((exact - kRoundingM) * inverse_voxel_).floor();
  const Eigen::Array3d high = ((exact + kRoundingM) * inverse_voxel_).floor();
  // Each axis may have been rounded its own way. Most points are far from every side: one voxel.
  const int corners = (low == high).all() ? 1 : 8;
  for (int corner = 0; corner < corners; ++corner) {
    voxels_.insert(key_of({corner & 1 ? high.x() : low.x(), corner & 2 ? high.y() : low.y(),
                           corner & 4 ? high.z() : low.z()}));
  }
}

bool MeasuredPoints::in_voxel_of(const Eigen::Vector3d& p_map) const {
  // The same operations as in StaticMap::add, so that points on a side fall to the same voxel.
  return voxels_.contains(key_of(((p_map - origin_) * inverse_voxel_).array().floor()));
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
