#include "evaluation/labels/map_voxels.hpp"

#include <bit>
#include <utility>

namespace stillmap::mapping {
namespace {

/// A mean this near to a side of its voxel may lie beyond it after rounding to float [m].
constexpr double kRoundingM = 1e-4;

/// Never 0. Tiles beyond 2^11 share keys with others, 40 km away.
std::uint64_t place_key(const VoxelGrid::Place& place) {
  const auto tile = [](std::int32_t axis) { return static_cast<std::uint64_t>(axis) & 0x7FFU; };
  return ((tile(place.tile.x) << 11U | tile(place.tile.y)) << 41U | place.voxel) + 1;
}

}  // namespace

MapVoxels::MapVoxels(const maps::MapPackage& map)
    : grid_(map.manifest().origin, map.manifest().voxel_size_m) {
  std::size_t points = 0;
  for (const maps::TileEntry& tile : map.manifest().tiles) points += tile.points;
  slots_.assign(std::bit_ceil(points + points / 2 + 2), 0);
  for (const maps::TileEntry& tile : map.manifest().tiles) {
    for (const maps::MapPoint& point : map.tile(tile.id)) {
      if (maps::is_measured(point.kind))
        insert(grid_.origin() + Eigen::Vector3f(point.x, point.y, point.z).cast<double>());
    }
  }
}

std::size_t MapVoxels::slot_of(std::uint64_t key) const {
  // Fibonacci hashing: the high bits of the product depend on all bits of the key.
  std::size_t slot = (key * 0x9E3779B97F4A7C15ULL) >>
                     (64U - static_cast<unsigned>(std::countr_zero(slots_.size())));
  while (slots_[slot] != 0 && slots_[slot] != key) slot = (slot + 1) & (slots_.size() - 1);
  return slot;
}

void MapVoxels::insert(const Eigen::Vector3d& p_map) {
  const auto place = grid_.find(p_map);
  if (!place) return;
  const auto insert_place = [this](const VoxelGrid::Place& at) {
    std::uint64_t& slot = slots_[slot_of(place_key(at))];
    if (slot == 0) ++size_;
    slot = place_key(at);
    if (4 * size_ < 3 * slots_.size()) return;
    std::vector<std::uint64_t> old(2 * slots_.size(), 0);
    std::swap(old, slots_);
    for (const std::uint64_t key : old) {
      if (key != 0) slots_[slot_of(key)] = key;
    }
  };
  insert_place(*place);
  const auto edge = static_cast<float>(grid_.voxel_size_m());
  const auto rounding = static_cast<float>(kRoundingM);
  if ((place->offset.array() > rounding).all() && (place->offset.array() < edge - rounding).all())
    return;
  // Each axis may have been rounded its own way.
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d side((corner & 1) != 0 ? 1 : -1, (corner & 2) != 0 ? 1 : -1,
                               (corner & 4) != 0 ? 1 : -1);
    if (const auto beside = grid_.find(p_map + kRoundingM * side)) insert_place(*beside);
  }
}

bool MapVoxels::hold(const Eigen::Vector3d& p_map) const {
  const auto place = grid_.find(p_map);
  return place && slots_[slot_of(place_key(*place))] != 0;
}

}  // namespace stillmap::mapping
