#include "cleaning/ground_levels.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Cells around a cell, nearest first, so that the first with ground is the nearest.
constexpr int kRings = static_cast<int>(GroundLevels::kReachM) - 1;

/// Ground with a gap of more than this between its heights is two: a storey of a garage has 2.3 m
/// and more, a terrain's step within a cell less [m].
constexpr float kStoreyM = 2.0F;
/// Fewer ground points in a cell are no storey: a bonnet, a hedge or a wall's top that was taken
/// for ground. Voxels of 0.1 m fill a cell with 100.
constexpr std::uint32_t kFewest = 10;
/// What stands on the ground may lie this much below its mean height in the cell [m].
constexpr float kBelowM = 0.3F;

std::vector<std::pair<int, int>> cells_by_distance() {
  std::vector<std::pair<int, int>> cells;
  for (int distance2 = 0; distance2 <= kRings * kRings; ++distance2) {
    for (int dy = -kRings; dy <= kRings; ++dy) {
      for (int dx = -kRings; dx <= kRings; ++dx) {
        if (dx * dx + dy * dy == distance2) cells.emplace_back(dx, dy);
      }
    }
  }
  return cells;
}

std::pair<std::int32_t, std::int32_t> cell_of(const Eigen::Vector3f& p) {
  return {static_cast<std::int32_t>(std::floor(p.x())),
          static_cast<std::int32_t>(std::floor(p.y()))};
}

}  // namespace

GroundLevels::GroundLevels(std::span<const Eigen::Vector3f> positions,
                           std::span<const std::uint8_t> is_ground) {
  if (is_ground.size() != positions.size())
    throw std::invalid_argument("is_ground: expected one flag a point");
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (is_ground[i] == 0) continue;
    const auto [x, y] = cell_of(positions[i]);
    add(positions[i].z(), cells_[maps::plane_cell_key(x, y)]);
  }
  for (auto& [key, cell] : cells_) settle(cell);
}

void GroundLevels::add(float z, Cell& cell) {
  Level own{z, z, static_cast<double>(z), 1};
  // The point may close the gap between two levels.
  std::erase_if(cell, [&](const Level& other) {
    if (z > other.highest + kStoreyM || z < other.lowest - kStoreyM) return false;
    own.lowest = std::min(own.lowest, other.lowest);
    own.highest = std::max(own.highest, other.highest);
    own.sum += other.sum;
    own.count += other.count;
    return true;
  });
  cell.push_back(own);
}

void GroundLevels::settle(Cell& cell) {
  if (cell.size() == 1) return;
  Level all;
  for (const Level& level : cell) {
    all.sum += level.sum;
    all.count += level.count;
  }
  std::erase_if(cell, [](const Level& level) { return level.count < kFewest; });
  if (cell.size() < 2) cell = {all};
  std::sort(cell.begin(), cell.end(),
            [](const Level& a, const Level& b) { return a.lowest < b.lowest; });
}

const GroundLevels::Level& GroundLevels::level_under(float z, const Cell& cell) {
  const Level* found = &cell.front();
  for (const Level& level : cell) {
    if (level.mean() <= z + kBelowM) found = &level;
  }
  return *found;
}

std::optional<float> GroundLevels::below(const Eigen::Vector3f& p) const {
  static const std::vector<std::pair<int, int>> around = cells_by_distance();
  const auto [x, y] = cell_of(p);
  std::optional<float> nearest;
  for (const auto& [dx, dy] : around) {
    const Cell* cell = cells_.find(maps::plane_cell_key(x + dx, y + dy));
    if (cell == nullptr) continue;
    const Level& level = level_under(p.z(), *cell);
    if (!nearest) nearest = level.mean();
    if (level.count < kFewest) return nearest;
    if (level.mean() <= p.z() + kStoreyM) return level.mean();
  }
  return nearest;
}

}  // namespace stillmap::mapping
