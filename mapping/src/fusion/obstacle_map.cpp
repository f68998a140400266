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

std::uint64_t key_of(const Eigen::Array3i& cell) {
  constexpr int kHalf = 1 << 20;
  std::uint64_t key = 0;
  for (Eigen::Index axis = 0; axis < 3; ++axis)
    key = key << 21U | (static_cast<std::uint64_t>(cell[axis] + kHalf) & 0x1FFFFFU);
  return key;
}

std::uint64_t key_of(const Eigen::Vector3f& p) {
  const Eigen::Array3i cell = (p / kVoxelM).array().floor().cast<int>();
  return key_of(cell);
}

std::uint64_t square_key(int x, int y) { return key_of(Eigen::Array3i(x, y, 0)); }

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
    keyed.emplace_back(key_of(obstacle), obstacle);
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
  squares_[square_key(square_of(obstacle.position.x(), kSquareM),
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
  // Ordered by key, so that nothing depends on the hash table.
  std::map<std::pair<int, int>, std::vector<Obstacle>> patches;
  std::vector<std::uint64_t> keys;
  keys.reserve(sums_.size());
  for (const auto& [key, sum] : sums_) keys.push_back(key);
  std::sort(keys.begin(), keys.end());
  for (const std::uint64_t key : keys) {
    const Sum& sum = sums_.at(key);
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
      const auto square = squares_.find(square_key(x, y));
      if (square == squares_.end()) continue;
      for (const Obstacle& each : square->second) {
        if ((each.position.head<2>() - c).squaredNorm() <= reach * reach) found.push_back(&each);
      }
    }
  }
  return found;
}

}  // namespace stillmap::mapping
