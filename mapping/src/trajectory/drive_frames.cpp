#include "trajectory/drive_frames.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <utility>

namespace stillmap::mapping {
namespace {

/// Beyond this two loops contradict each other, by whatever way [m].
constexpr double kContradictionM = 20.0;

/// Where the frame of drive `b` lies in that of `a`, as loops between them say; by {a, b}.
using Proposals = std::map<std::pair<std::size_t, std::size_t>, std::vector<Eigen::Isometry3d>>;

Proposals proposals_of(std::span<const DriveKeyframe> keyframes, std::span<const Loop> loops) {
  Proposals proposals;
  for (const Loop& loop : loops) {
    const DriveKeyframe& from = keyframes[loop.from];
    const DriveKeyframe& to = keyframes[loop.to];
    if (from.drive == to.drive) continue;
    const Eigen::Isometry3d T_from_to =
        from.T_odom_lidar * loop.T_from_to * to.T_odom_lidar.inverse();
    proposals[{from.drive, to.drive}].push_back(T_from_to);
    proposals[{to.drive, from.drive}].push_back(T_from_to.inverse());
  }
  return proposals;
}

/// The one that lies nearest to all others; what is far counts as much as what is farther.
Eigen::Isometry3d most_agreed(const std::vector<Eigen::Isometry3d>& proposed) {
  double least = std::numeric_limits<double>::infinity();
  const Eigen::Isometry3d* best = nullptr;
  for (const Eigen::Isometry3d& each : proposed) {
    double sum = 0.0;
    for (const Eigen::Isometry3d& other : proposed)
      sum += std::min(kContradictionM, (each.translation() - other.translation()).norm());
    if (sum < least) {
      least = sum;
      best = &each;
    }
  }
  return *best;
}

}  // namespace

std::vector<std::optional<Eigen::Isometry3d>> join_by_loops(
    std::size_t drives, std::span<const DriveKeyframe> keyframes, std::span<const Loop> loops) {
  const Proposals proposals = proposals_of(keyframes, loops);
  std::vector<std::optional<Eigen::Isometry3d>> frames(drives);
  if (drives > 0) frames[0] = Eigen::Isometry3d::Identity();
  while (true) {
    // The pair of a joined drive and one that is not with the most loops between them.
    const std::pair<const std::pair<std::size_t, std::size_t>, std::vector<Eigen::Isometry3d>>*
        next = nullptr;
    for (const auto& pair : proposals) {
      const auto& [a, b] = pair.first;
      if (!frames[a] || frames[b]) continue;
      if (next == nullptr || pair.second.size() > next->second.size()) next = &pair;
    }
    if (next == nullptr) return frames;
    const auto& [a, b] = next->first;
    frames[b] = *frames[a] * most_agreed(next->second);
  }
}

}  // namespace stillmap::mapping
