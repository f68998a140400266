#include "detection/column_grid.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr int kColumns = ColumnGrid::kSide * ColumnGrid::kSide;

}  // namespace

int ColumnGrid::column_of(float x, float y) {
  const float column = std::floor(x / kCellM) + 0.5F * kSide;
  const float row = std::floor(y / kCellM) + 0.5F * kSide;
  if (!(column >= 0.0F && column < kSide && row >= 0.0F && row < kSide)) return -1;
  return static_cast<int>(row) * kSide + static_cast<int>(column);
}

ColumnGrid::ColumnGrid(const maps::PointCloud& cloud, const GroundResult& ground) {
  std::vector<std::pair<int, RaisedPoint>> found;
  starts_.assign(static_cast<std::size_t>(kColumns) + 1, 0);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (ground.is_ground[i] != 0) continue;
    const Eigen::Vector3f& p = cloud.positions[i];
    const int column = column_of(p.x(), p.y());
    if (column < 0) continue;
    const auto below = ground.surface->z_at(static_cast<double>(p.x()), static_cast<double>(p.y()));
    if (!below) continue;
    const float height_m = p.z() - static_cast<float>(*below);
    if (!(height_m > kMinHeightM && height_m < kMaxHeightM)) continue;
    found.push_back({column, {p, height_m, cloud.origin_of(i).head<2>()}});
    ++starts_[static_cast<std::size_t>(column) + 1];
  }
  for (std::size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
  points_.resize(found.size());
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
  for (const auto& [column, point] : found)
    points_[next[static_cast<std::size_t>(column)]++] = point;
}

std::vector<std::vector<int>> ColumnGrid::clusters(const std::vector<std::uint8_t>& member,
                                                   int reach) const {
  std::vector<std::uint8_t> open = member;
  std::vector<std::vector<int>> all;
  for (int seed = 0; seed < kColumns; ++seed) {
    if (open[static_cast<std::size_t>(seed)] == 0) continue;
    open[static_cast<std::size_t>(seed)] = 0;
    std::vector<int> cluster{seed};
    std::uint32_t points = 0;
    for (std::size_t at = 0; at < cluster.size(); ++at) {
      const int column = cluster[at];
      points += first(column + 1) - first(column);
      const int x = column % kSide, y = column / kSide;
      for (int ny = std::max(0, y - reach); ny <= std::min(kSide - 1, y + reach); ++ny) {
        for (int nx = std::max(0, x - reach); nx <= std::min(kSide - 1, x + reach); ++nx) {
          std::uint8_t& neighbour = open[static_cast<std::size_t>(ny * kSide + nx)];
          if (neighbour != 0) cluster.push_back(ny * kSide + nx);
          neighbour = 0;
        }
      }
    }
    if (points < 2) continue;
    std::sort(cluster.begin(), cluster.end());
    all.push_back(std::move(cluster));
  }
  return all;
}

}  // namespace stillmap::mapping
