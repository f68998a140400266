#include "cleaning/ground_levels.hpp"

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Cells around a cell, nearest first, so that the first with ground is the nearest.
constexpr int kRings = static_cast<int>(GroundLevels::kReachM) - 1;

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

std::uint64_t key_of(std::int32_t x, std::int32_t y) {
  return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32U) |
         static_cast<std::uint32_t>(y);
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
    Cell& cell = cells_[key_of(x, y)];
    cell.sum += static_cast<double>(positions[i].z());
    ++cell.count;
  }
}

std::optional<float> GroundLevels::below(const Eigen::Vector3f& p) const {
  static const std::vector<std::pair<int, int>> around = cells_by_distance();
  const auto [x, y] = cell_of(p);
  for (const auto& [dx, dy] : around) {
    const auto at = cells_.find(key_of(x + dx, y + dy));
    if (at != cells_.end()) return static_cast<float>(at->second.sum / at->second.count);
  }
  return std::nullopt;
}

}  // namespace stillmap::mapping
