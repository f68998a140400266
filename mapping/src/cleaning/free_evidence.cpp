#include "cleaning/free_evidence.hpp"

#include <algorithm>
#include <cmath>

namespace stillmap::mapping {
namespace {

constexpr double kKeyframeStepM = 0.7;
constexpr double kKeyframeTurnRad = 0.17;
constexpr std::size_t kKeyframeScans = 20;

/// Farther views tell less: a cell of 10 cm is smaller than the gap between shots.
constexpr float kReachM = 40.0F;
/// Nearer ones meet the own vehicle.
constexpr float kNearestM = 2.0F;

void take(SightCounts& counts, Sight sight) {
  switch (sight) {
    case Sight::kUnknown:
      return;
    case Sight::kHidden:
      ++counts.hidden;
      return;
    case Sight::kMixed:
      ++counts.mixed;
      return;
    case Sight::kHit:
      ++counts.hit;
      counts.open_run = 0;
      return;
    case Sight::kFree:
      ++counts.free;
      ++counts.open_run;
      counts.free_run = std::max(counts.free_run, counts.open_run);
      return;
  }
}

}  // namespace

std::vector<std::size_t> select_keyframes(const std::vector<Eigen::Isometry3d>& T_local_lidar) {
  std::vector<std::size_t> keyframes;
  for (std::size_t i = 0; i < T_local_lidar.size(); ++i) {
    if (!keyframes.empty()) {
      const Eigen::Isometry3d T_last_this =
          T_local_lidar[keyframes.back()].inverse() * T_local_lidar[i];
      const double turn = Eigen::AngleAxisd(T_last_this.linear()).angle();
      if (T_last_this.translation().norm() < kKeyframeStepM && turn < kKeyframeTurnRad &&
          i - keyframes.back() < kKeyframeScans)
        continue;
    }
    keyframes.push_back(i);
  }
  return keyframes;
}

std::vector<SightCounts> count_sights(std::span<const Eigen::Vector3f> positions, float radius_m,
                                      const PosedViews& views,
                                      std::span<const std::size_t> keyframes) {
  std::vector<SightCounts> counts(positions.size());
  for (const std::size_t scan : keyframes) {
    const std::shared_ptr<const RangeView> view = views.read(scan);
    const Eigen::Isometry3f T_lidar_local = views.T_local_lidar[scan].inverse().cast<float>();
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const Eigen::Vector3f p = T_lidar_local * positions[i];
      const float range2 = p.squaredNorm();
      if (range2 > kReachM * kReachM || range2 < kNearestM * kNearestM) continue;
      take(counts[i], view->sight(p, radius_m));
    }
  }
  return counts;
}

}  // namespace stillmap::mapping
