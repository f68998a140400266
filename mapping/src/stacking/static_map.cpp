#include "stacking/static_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

constexpr std::int64_t kBits = 21;
constexpr std::int64_t kHalf = std::int64_t{1} << (kBits - 1);

/// Three signed 21-bit cells, and one bit for moved points. @return false when out of range.
bool key_of(const Eigen::Array3d& cell, bool moved, std::uint64_t& key) {
  key = 0;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    // Comparisons fail on NaN, so that what is not finite is out of range too.
    if (!(cell[axis] >= static_cast<double>(-kHalf) && cell[axis] < static_cast<double>(kHalf)))
      return false;
    key =
        (key << kBits) | static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[axis]) + kHalf);
  }
  key = (key << 1U) | (moved ? 1U : 0U);
  return true;
}

}  // namespace

StaticMap::StaticMap(const Eigen::Vector3d& origin, double voxel_size_m)
    : origin_(origin), inverse_voxel_(1.0 / voxel_size_m) {
  if (!(voxel_size_m > 0.0)) throw std::invalid_argument("voxel size: expected > 0");
}

bool StaticMap::add(const StackedPoint& point) {
  const Eigen::Vector3d p = point.p_map - origin_;
  const bool measured = maps::is_measured(point.kind);
  std::uint64_t key = 0;
  if (!key_of((p * inverse_voxel_).array().floor(), !measured, key)) return false;
  const auto [at, inserted] = index_.try_emplace(key, static_cast<std::uint32_t>(cells_.size()));
  if (inserted) cells_.push_back({.key = key});
  Cell& cell = cells_[at->second];
  cell.sum += p;
  cell.intensity_sum += static_cast<double>(point.intensity);
  ++cell.observations;
  if (point.kind == maps::PointKind::kGround) ++cell.ground_observations;
  if (!measured) {
    cell.kind = point.kind;
    cell.object = point.object;
  }
  return true;
}

maps::MapPoint StaticMap::to_point(const Cell& cell) {
  const double count = cell.observations;
  const Eigen::Vector3f mean = (cell.sum / count).cast<float>();
  maps::PointKind kind = cell.kind;
  if (maps::is_measured(kind) && 2 * cell.ground_observations > cell.observations)
    kind = maps::PointKind::kGround;
  const auto most = std::uint32_t{std::numeric_limits<std::uint16_t>::max()};
  return {mean.x(),
          mean.y(),
          mean.z(),
          static_cast<float>(cell.intensity_sum / count),
          static_cast<std::uint16_t>(std::min(cell.observations, most)),
          kind,
          cell.object};
}

std::map<maps::TileId, std::vector<maps::MapPoint>> StaticMap::tiles() const {
  std::vector<std::uint32_t> order(cells_.size());
  for (std::uint32_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [this](std::uint32_t a, std::uint32_t b) { return cells_[a].key < cells_[b].key; });
  std::map<maps::TileId, std::vector<maps::MapPoint>> tiles;
  for (const std::uint32_t i : order) {
    const maps::MapPoint point = to_point(cells_[i]);
    const auto cell_of = [](float coordinate_m) {
      return static_cast<std::int32_t>(
          std::floor(static_cast<double>(coordinate_m) / maps::kTileSizeM));
    };
    tiles[{0, cell_of(point.x), cell_of(point.y)}].push_back(point);
  }
  return tiles;
}

}  // namespace stillmap::mapping
