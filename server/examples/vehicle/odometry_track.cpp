#include "odometry_track.hpp"

#include <algorithm>
#include <vector>

namespace stillmap::vehicle {

void OdometryTrack::add(std::int64_t stamp_ns, const Eigen::Isometry3d& T_odom_base) {
  constexpr std::int64_t kKept_ns = 10'000'000'000;
  constexpr std::int64_t kSetBack_ns = 1'000'000'000;
  if (!T_odom_base.matrix().allFinite()) return;
  if (!poses_.empty() && stamp_ns < poses_.back().stamp_ns - kSetBack_ns) poses_.clear();
  if (!poses_.empty() && stamp_ns <= poses_.back().stamp_ns) return;
  poses_.push_back({stamp_ns, T_odom_base});
  while (poses_.front().stamp_ns < stamp_ns - kKept_ns) poses_.pop_front();
}

std::optional<Eigen::Isometry3d> OdometryTrack::at(std::int64_t stamp_ns) const {
  const auto after = std::lower_bound(
      poses_.begin(), poses_.end(), stamp_ns,
      [](const maps::StampedPose& pose, std::int64_t stamp) { return pose.stamp_ns < stamp; });
  if (after == poses_.begin() && (after == poses_.end() || after->stamp_ns > stamp_ns))
    return std::nullopt;
  // The two before it, which tell the velocity beyond the newest, and the one after it.
  const auto first = after - std::min<std::ptrdiff_t>(2, after - poses_.begin());
  const auto last = after == poses_.end() ? after : after + 1;
  return maps::Trajectory(std::vector<maps::StampedPose>(first, last)).at(stamp_ns);
}

}  // namespace stillmap::vehicle
