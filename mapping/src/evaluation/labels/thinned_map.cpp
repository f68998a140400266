#include "evaluation/labels/thinned_map.hpp"

#include "evaluation/labels/removed_points.hpp"

#include <utility>

namespace stillmap::mapping {
namespace {

constexpr double kSameM = 0.05;
constexpr double kSameVoxelM = 0.1;
/// Projected points lie below where they were; this much above says that it is another floor [m].
constexpr float kMostRiseM = 0.3F;

}  // namespace

struct ThinnedMap::Parts {
  double voxel_size_m = 0.1;
  std::vector<Eigen::Vector3f> measured, moved, projected;
  std::vector<float> heights;
};

ThinnedMap::Parts ThinnedMap::parts_of(const maps::MapPackage& map) {
  Parts parts;
  parts.voxel_size_m = map.manifest().voxel_size_m;
  for_each_point(map, [&](const Eigen::Vector3f& p, maps::PointKind kind) {
    (maps::is_measured(kind) ? parts.measured : parts.moved).push_back(p);
    if (kind != maps::PointKind::kProjected) return;
    parts.projected.emplace_back(p.x(), p.y(), 0.0F);
    parts.heights.push_back(p.z());
  });
  return parts;
}

ThinnedMap::ThinnedMap(const maps::MapPackage& map) : ThinnedMap(parts_of(map)) {}

ThinnedMap::ThinnedMap(Parts parts)
    : voxel_size_m_(parts.voxel_size_m),
      measured_(std::move(parts.measured), kSameVoxelM),
      moved_(std::move(parts.moved), kSameVoxelM),
      projected_(std::move(parts.projected), parts.voxel_size_m),
      projected_heights_(std::move(parts.heights)) {}

unsigned ThinnedMap::met(const Eigen::Vector3f& p) const {
  // Most truth points have a measured point this near, and a short search finds it.
  if (measured_.any_within(p, kSameM)) return RemovedPoints::kAll;
  unsigned met = 0;
  if (measured_.any_within(p, kSameVoxelM))
    met |= RemovedPoints::kMeasuredNear | RemovedPoints::kAnyNear;
  if (const auto nearest = moved_.nearest(p, kSameVoxelM)) {
    met |= RemovedPoints::kAnyNear;
    if (nearest->squared_distance_m2 <= kSameM * kSameM) met |= RemovedPoints::kAnySame;
  }
  return met;
}

std::optional<Eigen::Vector3f> ThinnedMap::landing_of(const Eigen::Vector3f& p) const {
  // The mean of its voxel is less than a diagonal away, seen from above.
  const auto below = projected_.nearest({p.x(), p.y(), 0.0F}, 1.5 * voxel_size_m_);
  if (!below) return std::nullopt;
  const float height = projected_heights_[below->point];
  if (height > p.z() + kMostRiseM) return std::nullopt;
  return Eigen::Vector3f(p.x(), p.y(), height);
}

}  // namespace stillmap::mapping
