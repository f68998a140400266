#include "cleaning/free_space_cleaner.hpp"
#include "cleaning/ground_levels.hpp"
#include "cleaning/moved_cells.hpp"
#include "cleaning/seldom_hit.hpp"

#include <algorithm>
#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Over the ground [m]: kerbs and grass below, crowns, signs and bridges above.
constexpr float kLowestM = 0.1F;
constexpr float kHighestM = 4.5F;

/// What lies together within this belongs together [m], at least two voxels.
constexpr double kBallM = 0.3;
/// Share of the views.
constexpr float kMostlyHit = 0.5F;

/// Of a cell, as a share of the voxel: a little more than half its edge.
constexpr double kCellRadius = 0.6;

float ball_of(double voxel_size_m) {
  return static_cast<float>(std::max(kBallM, 2.0 * voxel_size_m));
}

/// Whether what moves can be there.
bool in_band(const Eigen::Vector3f& p, const GroundLevels& ground) {
  const std::optional<float> level = ground.below(p);
  if (!level) return true;
  const float height_m = p.z() - *level;
  return height_m >= kLowestM && height_m <= kHighestM;
}

}  // namespace

double free_space_rim_m(double voxel_size_m) {
  return kMovedReachBalls * static_cast<double>(ball_of(voxel_size_m)) + GroundLevels::kReachM;
}

std::vector<std::uint8_t> moved_by_free_space(const CleaningPoints& points,
                                              const Eigen::AlignedBox2f& area,
                                              const PosedViews& views,
                                              std::span<const Keyframe> keyframes) {
  if (!(points.voxel_size_m > 0.0)) throw std::invalid_argument("voxel size: expected > 0");
  const float ball_m = ball_of(points.voxel_size_m);
  Eigen::AlignedBox2f reached = area;
  reached.min().array() -= kMovedReachBalls * ball_m;
  reached.max().array() += kMovedReachBalls * ball_m;
  const GroundLevels ground(points.positions, points.is_ground);
  std::vector<std::uint32_t> asked;
  std::vector<Eigen::Vector3f> positions;
  for (std::uint32_t i = 0; i < points.positions.size(); ++i) {
    const Eigen::Vector3f& p = points.positions[i];
    if (points.is_ground[i] != 0 || !reached.contains(Eigen::Vector2f(p.head<2>())) ||
        !in_band(p, ground))
      continue;
    asked.push_back(i);
    positions.push_back(p);
  }
  const auto radius_m = static_cast<float>(kCellRadius * points.voxel_size_m);
  const std::vector<FreeEvidence> evidence =
      find_free_evidence(positions, radius_m, views, keyframes);
  const std::vector<std::uint8_t> moved = moved_cells(positions, evidence, ball_m);
  std::vector<std::uint8_t> flags = seldom_hit(points, reached, views, keyframes);
  float weight = 0.0F;
  for (const Keyframe& keyframe : keyframes) weight += keyframe.weight;
  for (std::size_t k = 0; k < asked.size(); ++k) {
    // Hit seldom in the map, since detections took most of what was hit there, but not by the
    // views.
    const bool stays = evidence[k].hits >= kMostlyHit * weight;
    flags[asked[k]] = moved[k] != 0 || (flags[asked[k]] != 0 && !stays) ? 1 : 0;
  }
  return flags;
}

}  // namespace stillmap::mapping
