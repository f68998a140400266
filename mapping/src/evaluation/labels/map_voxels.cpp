#include "evaluation/labels/map_voxels.hpp"

#include <utility>

namespace stillmap::mapping {
namespace {

/// A mean this near to a side of its voxel may lie beyond it after rounding to float [m].
constexpr double kRoundingM = 1e-4;

/// Tiles beyond 2^11 share keys with others, 40 km away.
std::uint64_t place_key(const VoxelGrid::Place& place) {
  const auto tile = [](std::int32_t axis) { return static_cast<std::uint64_t>(axis) & 0x7FFU; };
  return (tile(place.tile.x) << 11U | tile(place.tile.y)) << 41U | place.voxel;
}

}  // namespace

MapVoxels::MapVoxels(const maps::MapPackage& map)
    : grid_(map.manifest().origin, map.manifest().voxel_size_m) {
  for (const maps::TileEntry& entry : map.tiles()) {
    const maps::MapTile tile = map.tile(entry.id);
    for (const maps::MapPoint& point : tile) {
      if (maps::is_measured(point.kind)) insert(tile.position(point));
    }
  }
}

void MapVoxels::insert(const Eigen::Vector3d& p_map) {
  const auto place = grid_.find(p_map);
  if (!place) return;
  const auto insert_place = [this](const VoxelGrid::Place& at) {
    const std::uint64_t key = place_key(at);
    if (index_.insert(key, key_at()).second) keys_.push_back(key);
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
  return place && index_.find(place_key(*place), key_at()) != maps::CellIndex::kNone;
}

}  // namespace stillmap::mapping
