#include "bags/poses_near_scans.hpp"

#include <algorithm>
#include <map>
#include <utility>

namespace stillmap::maps {

PosesNearScans::PosesNearScans(std::vector<std::int64_t> stamps_ns)
    : stamps_ns_(std::move(stamps_ns)) {
  std::sort(stamps_ns_.begin(), stamps_ns_.end());
}

void PosesNearScans::add(std::int64_t stamp_ns, const Eigen::Isometry3d& T) {
  ++added_;
  const StampedPose pose{stamp_ns, T};
  const auto scan = std::lower_bound(stamps_ns_.begin(), stamps_ns_.end(), stamp_ns);
  Gap& gap = gaps_[static_cast<std::size_t>(scan - stamps_ns_.begin())];
  if (!gap.first || stamp_ns < gap.first->stamp_ns) gap.first = pose;
  if (!gap.last || stamp_ns > gap.last->stamp_ns) gap.last = pose;
  keep_ends(pose);
}

void PosesNearScans::keep_ends(const StampedPose& pose) {
  const auto keep = [&](std::vector<StampedPose>& ends, auto before) {
    const auto place = std::find_if(ends.begin(), ends.end(), [&](const StampedPose& each) {
      return !before(each.stamp_ns, pose.stamp_ns);
    });
    if (place != ends.end() && place->stamp_ns == pose.stamp_ns) return;
    ends.insert(place, pose);
    if (ends.size() > 2) ends.pop_back();
  };
  keep(earliest_, std::less<>());
  keep(latest_, std::greater<>());
}

Trajectory PosesNearScans::trajectory() const {
  std::map<std::int64_t, Eigen::Isometry3d> kept;
  const auto keep = [&](const StampedPose& pose) { kept.emplace(pose.stamp_ns, pose.T_map_lidar); };
  for (const auto& [number, gap] : gaps_) {
    if (gap.first) keep(*gap.first);
    if (gap.last) keep(*gap.last);
  }
  for (const StampedPose& pose : earliest_) keep(pose);
  for (const StampedPose& pose : latest_) keep(pose);
  std::vector<StampedPose> poses;
  for (const auto& [stamp_ns, T] : kept) poses.push_back({stamp_ns, T});
  return Trajectory(std::move(poses));
}

}  // namespace stillmap::maps
