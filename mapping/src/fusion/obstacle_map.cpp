#include "fusion/obstacle_map.hpp"

#include "stacking/normals.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace stillmap::mapping {
namespace {

constexpr float kVoxelM = 0.15F;
constexpr float kSquareM = 2.0F;
/// Normals are estimated in squares of this, so that few voxels lie at a border [m].
constexpr float kPatchM = 16.0F;
constexpr float kObstacleReachM = 35.0F;
constexpr float kLowestM = 0.1F;
constexpr float kHighestM = 4.0F;

std::uint64_t obstacle_key(const Eigen::Vector3f& p) {
  const Eigen::Array3i cell = (p / kVoxelM).array().floor().cast<int>();
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
  for (const Obstacle& each : obstacles) put(each);
}

void ObstacleMap::put(const Obstacle& obstacle) {
  squares_[maps::plane_cell_key(square_of(obstacle.position.x(), kSquareM),
                                square_of(obstacle.position.y(), kSquareM))]
      .push_back(obstacle);
}

std::vector<Obstacle> ObstacleMap::all() const {
  std::vector<Obstacle> obstacles;
  for (const auto& [key, square] : squares_)
    obstacles.insert(obstacles.end(), square.begin(), square.end());
  return obstacles;
}

void ObstacleMap::add(const ScanObstacles& scan) {
  for (const ScanObstacles::Voxel& voxel : scan.voxels) {
    Sum& sum = sums_[voxel.key];
    sum.sum += voxel.sum;
    sum.points += voxel.points;
    ++sum.scans;
  }
}

void ObstacleMap::finish() {
  std::map<std::pair<int, int>, std::vector<Obstacle>> patches;
  // By place, whatever the order of the scans.
  std::sort(sums_.begin(), sums_.end(), [](const auto& a, const auto& b) { return a.key < b.key; });
  for (const auto& [key, sum] : sums_) {
    Obstacle obstacle;
    obstacle.position = sum.sum / static_cast<float>(sum.points);
    obstacle.scans = sum.scans;
    patches[{square_of(obstacle.position.x(), kPatchM), square_of(obstacle.position.y(), kPatchM)}]
        .push_back(obstacle);
  }
  sums_.clear();
  for (auto& [patch, obstacles] : patches) {
    std::vector<Eigen::Vector3f> positions;
    for (const Obstacle& each : obstacles) positions.push_back(each.position);
    const std::vector<SurfaceNormal> normals = estimate_normals(positions, positions);
    for (std::size_t i = 0; i < obstacles.size(); ++i) {
      obstacles[i].planarity = normals[i].planarity;
      put(obstacles[i]);
    }
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
