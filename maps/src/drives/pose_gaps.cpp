#include "drives/pose_gaps.hpp"

#include <stillmap/maps/median.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <vector>

namespace stillmap::maps {
namespace {

constexpr std::uint64_t kLongestQuietNs = 1'000'000'000;
/// Times the median between two poses: then they are dense.
constexpr std::uint64_t kDenser = 5;
/// Noise of the poses of a sensor that stands still.
constexpr double kStillM = 0.2, kStillRad = 0.01;

std::uint64_t between_ns(const StampedPose& before, const StampedPose& after) {
  return static_cast<std::uint64_t>(after.stamp_ns) - static_cast<std::uint64_t>(before.stamp_ns);
}

/// @return the largest number for fewer than two poses.
std::uint64_t median_ns(const std::vector<StampedPose>& path) {
  std::vector<std::uint64_t> all;
  for (std::size_t i = 1; i < path.size(); ++i) all.push_back(between_ns(path[i - 1], path[i]));
  if (all.empty()) return std::numeric_limits<std::uint64_t>::max();
  return median(std::move(all));
}

bool stood_still(const Eigen::Isometry3d& before, const Eigen::Isometry3d& after) {
  const Eigen::Isometry3d step = before.inverse() * after;
  return step.translation().norm() <= kStillM &&
         Eigen::AngleAxisd(step.linear()).angle() <= kStillRad;
}

}  // namespace

PoseGaps::PoseGaps(const Trajectory& path) : path_(path) {
  const std::uint64_t median = median_ns(path.poses());
  const std::uint64_t most = std::numeric_limits<std::uint64_t>::max() / kDenser;
  least_ns_ = std::max(kLongestQuietNs, kDenser * std::min(median, most));
}

PoseGaps::Place PoseGaps::of(std::int64_t stamp_ns) const {
  const std::vector<StampedPose>& poses = path_.poses();
  const auto after = std::lower_bound(
      poses.begin(), poses.end(), stamp_ns,
      [](const StampedPose& pose, std::int64_t value) { return pose.stamp_ns < value; });
  if (after == poses.begin() || after == poses.end() || after->stamp_ns == stamp_ns)
    return Place::kKnown;
  const StampedPose& before = *(after - 1);
  const std::uint64_t gap_ns = between_ns(before, *after);
  if (gap_ns <= kLongestQuietNs) return Place::kKnown;
  return gap_ns <= least_ns_ || stood_still(before.T_map_lidar, after->T_map_lidar)
             ? Place::kBridged
             : Place::kUnknown;
}

bool ScansInGaps::add(PoseGaps::Place place) {
  bridged += place == PoseGaps::Place::kBridged ? 1 : 0;
  left_out += place == PoseGaps::Place::kUnknown ? 1 : 0;
  return place != PoseGaps::Place::kUnknown;
}

void ScansInGaps::note(Drive::Contents& contents, const std::string& source) const {
  if (left_out > 0)
    contents.notes.push_back(
        fmt::format("{} scans left out, which lie in gaps of over 1 s between poses of {} while "
                    "the sensor moved; to keep them, give poses without gaps",
                    left_out, source));
  if (bridged > 0)
    contents.notes.push_back(
        fmt::format("{} scans lie in gaps of over 1 s between poses of {}, and are placed on a "
                    "straight line across them",
                    bridged, source));
}

}  // namespace stillmap::maps
