#include "odometry/loam/feature_map.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace stillmap::mapping::loam {
namespace {

constexpr std::size_t kFirstCells = 2000;
/// A mean of so many points is as good as it gets; later ones count as much as the last of these,
/// so that the map follows slowly where it is wrong.
constexpr std::uint16_t kMaxCount = 30;

}  // namespace

FeatureMap::FeatureMap(double cell_m, double voxel_m)
    : cell_m_(cell_m), voxel_m_(voxel_m), index_(kFirstCells) {}

FeatureMap::Key FeatureMap::key_of(const Eigen::Vector3d& p) const {
  const Eigen::Array3d cell = (p / cell_m_).array().floor();
  return {static_cast<std::int32_t>(cell.x()), static_cast<std::int32_t>(cell.y()),
          static_cast<std::int32_t>(cell.z())};
}

std::uint64_t FeatureMap::number_key(const Key& key) {
  return maps::signed_cell_key(key[0], key[1], key[2]);
}

const FeatureMap::Cell* FeatureMap::find(const Key& key) const {
  const std::uint32_t at = index_.find(number_key(key), key_at());
  return at == maps::CellIndex::kNone ? nullptr : &cells_[at];
}

FeatureMap::Cell& FeatureMap::find_or_add(const Key& key) {
  const auto [at, is_new] = index_.insert(number_key(key), key_at());
  if (is_new) cells_.push_back({key, {}});
  return cells_[at];
}

void FeatureMap::add(const Eigen::Vector3d& p_odom) {
  const Key key = key_of(p_odom);
  const Eigen::Vector3d corner = cell_m_ * Eigen::Vector3d(key[0], key[1], key[2]);
  const Eigen::Vector3f p = (p_odom - corner).cast<float>();
  const auto side = static_cast<int>(std::ceil(cell_m_ / voxel_m_));
  const Eigen::Array3i v =
      (p / static_cast<float>(voxel_m_)).array().floor().cast<int>().max(0).min(side - 1);
  const auto voxel = static_cast<std::uint16_t>((v.z() * side + v.y()) * side + v.x());
  std::vector<Point>& points = find_or_add(key).points;
  const auto same = std::find_if(points.begin(), points.end(),
                                 [&](const Point& other) { return other.voxel == voxel; });
  if (same == points.end()) {
    points.push_back({p, voxel, 1});
    ++points_;
    return;
  }
  same->count = std::min<std::uint16_t>(static_cast<std::uint16_t>(same->count + 1), kMaxCount);
  same->mean += (p - same->mean) / static_cast<float>(same->count);
}

FeatureMap::Neighbours FeatureMap::nearest(const Eigen::Vector3d& q_odom) const {
  Neighbours out;
  std::array<float, kMapNeighbours> squared;
  squared.fill(std::numeric_limits<float>::infinity());
  const auto reach = static_cast<float>(0.25 * cell_m_ * cell_m_);
  const Key low = key_of(q_odom - Eigen::Vector3d::Constant(0.5 * cell_m_));
  for (int c = 0; c < 8; ++c) {
    const Key key{low[0] + (c & 1), low[1] + ((c >> 1) & 1), low[2] + (c >> 2)};
    const Cell* cell = find(key);
    if (cell == nullptr) continue;
    const Eigen::Vector3f q =
        (q_odom - cell_m_ * Eigen::Vector3d(key[0], key[1], key[2])).cast<float>();
    for (const Point& point : cell->points) {
      const Eigen::Vector3f d = point.mean - q;
      const float s = d.squaredNorm();
      if (!(s < reach && s < squared.back())) continue;
      std::size_t at = std::min(out.count, kMapNeighbours - 1);
      for (; at > 0 && squared[at - 1] > s; --at) {
        squared[at] = squared[at - 1];
        out.points[at] = out.points[at - 1];
      }
      squared[at] = s;
      out.points[at] = d;
      out.count = std::min(out.count + 1, kMapNeighbours);
    }
  }
  return out;
}

void FeatureMap::keep_around(const Eigen::Vector3d& centre_odom, double radius_m) {
  std::erase_if(cells_, [&](const Cell& cell) {
    const Eigen::Vector3d middle =
        cell_m_ * (Eigen::Vector3d(cell.key[0], cell.key[1], cell.key[2]).array() + 0.5).matrix();
    if ((middle - centre_odom).norm() <= radius_m) return false;
    points_ -= cell.points.size();
    return true;
  });
  index_ = maps::CellIndex(kFirstCells);
  for (const Cell& cell : cells_) static_cast<void>(index_.insert(number_key(cell.key), key_at()));
}

void FeatureMap::clear() {
  cells_.clear();
  points_ = 0;
  index_ = maps::CellIndex(kFirstCells);
}

}  // namespace stillmap::mapping::loam
