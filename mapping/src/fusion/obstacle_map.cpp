#include "fusion/obstacle_map.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr float kSquareM = 2.0F;
constexpr float kObstacleReachM = 35.0F;
constexpr float kLowestM = 0.1F;
constexpr float kHighestM = 4.0F;

std::uint64_t obstacle_key(const Eigen::Vector3f& p) {
  const Eigen::Array3i cell = (p / kObstacleVoxelM).array().floor().cast<int>();
  return maps::signed_cell_key(cell.x(), cell.y(), cell.z());
}

int square_of(float value, float side_m) { return static_cast<int>(std::floor(value / side_m)); }

}  // namespace

ScanObstacles reduce_obstacles(const std::vector<Eigen::Vector3f>& positions,
                               const std::vector<std::uint8_t>& is_ground,
                               const GroundSurface& surface,
                               const Eigen::Isometry3d& T_local_lidar) {
  const Eigen::Isometry3f T = T_local_lidar.cast<float>();
  std::vector<std::pair<std::uint64_t, Eigen::Vector3f>> keyed;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Eigen::Vector3f& p = positions[i];
    if (is_ground[i] != 0 || p.head<2>().squaredNorm() > kObstacleReachM * kObstacleReachM)
      continue;
    const auto ground = surface.at(static_cast<double>(p.x()), static_cast<double>(p.y()));
    if (!ground) continue;
    const float height_m = p.z() - static_cast<float>(ground->z);
    if (!(height_m > kLowestM && height_m < kHighestM)) continue;
    Eigen::Vector3f obstacle = T * p;
    obstacle.z() = height_m;
    keyed.emplace_back(obstacle_key(obstacle), obstacle);
  }
  std::stable_sort(keyed.begin(), keyed.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  ScanObstacles out;
  for (const auto& [key, p] : keyed) {
    if (out.voxels.empty() || out.voxels.back().key != key)
      out.voxels.push_back({key, Eigen::Vector3f::Zero(), 0});
    out.voxels.back().sum += p;
    ++out.voxels.back().points;
  }
  return out;
}

ObstacleMap::ObstacleMap(const std::vector<Obstacle>& obstacles) {
  for (const Obstacle& each : obstacles) {
    squares_[maps::plane_cell_key(square_of(each.position.x(), kSquareM),
                                  square_of(each.position.y(), kSquareM))]
        .push_back(each);
  }
}

std::vector<const Obstacle*> ObstacleMap::around(const Eigen::Vector2d& centre,
                                                 double radius_m) const {
  std::vector<const Obstacle*> found;
  const auto reach = static_cast<float>(radius_m);
  const Eigen::Vector2f c = centre.cast<float>();
  for (int x = square_of(c.x() - reach, kSquareM); x <= square_of(c.x() + reach, kSquareM); ++x) {
    for (int y = square_of(c.y() - reach, kSquareM); y <= square_of(c.y() + reach, kSquareM); ++y) {
      const std::vector<Obstacle>* square = squares_.find(maps::plane_cell_key(x, y));
      if (square == nullptr) continue;
      for (const Obstacle& each : *square) {
        if ((each.position.head<2>() - c).squaredNorm() <= reach * reach) found.push_back(&each);
      }
    }
  }
  return found;
}

}  // namespace stillmap::mapping
