#include "trajectory/drive_pose_faults.hpp"

#include "trajectory/levelling.hpp"

#include <stillmap/maps/median.hpp>
#include <stillmap/maps/trajectory.hpp>

#include <algorithm>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Steps longer than this and as many usual ones are gaps.
constexpr double kLongestStepS = 1.0;
constexpr double kStepsOfGap = 5.0;

/// A scan that is not matched may be of dust or of a cover.
std::optional<std::size_t> matched_nearest_to_middle(std::span<const OdometryPose> odometry) {
  const std::size_t middle = odometry.size() / 2;
  for (std::size_t away = 0; away <= middle; ++away) {
    for (const std::size_t i : {middle - away, middle + away})
      if (i < odometry.size() && odometry[i].status == OdometryStatus::kMatched) return i;
  }
  return std::nullopt;
}

}  // namespace

PathPair paths_of(const maps::Drive& drive, std::size_t begin,
                  std::span<const OdometryPose> odometry) {
  const std::int64_t zero_ns = drive.stamp_ns(begin);
  const auto seconds = [&](std::int64_t stamp_ns) {
    return maps::seconds_between(zero_ns, stamp_ns);
  };
  const auto mark_gaps = [](std::vector<SmoothPath::Pose>& poses) {
    if (poses.size() < 2) return;
    std::vector<double> steps_s;
    for (std::size_t i = 1; i < poses.size(); ++i)
      steps_s.push_back(poses[i].t_s - poses[i - 1].t_s);
    const double longest_s =
        std::max(kLongestStepS, kStepsOfGap * maps::median(std::move(steps_s)));
    for (std::size_t i = 1; i < poses.size(); ++i)
      if (poses[i].t_s - poses[i - 1].t_s > longest_s) poses[i].follows = false;
  };
  PathPair paths;
  // After a stretch that odometry lost, what it was off by shows in the step to the first match.
  const auto matched = [&](std::size_t i) {
    return odometry[i].status == OdometryStatus::kMatched;
  };
  for (std::size_t i = 0; i < odometry.size(); ++i)
    paths.odometry.push_back({seconds(drive.stamp_ns(begin + i)), odometry[i].T_odom_lidar,
                              i > 0 && matched(i) && matched(i - 1)});
  if (const auto& path = drive.contents().path) {
    for (const maps::StampedPose& pose : path->poses())
      paths.given.push_back({seconds(pose.stamp_ns), pose.T_map_lidar});
  } else {
    for (std::size_t i = 0; i < odometry.size(); ++i)
      paths.given.push_back({seconds(drive.stamp_ns(begin + i)), drive.T_map_lidar(begin + i)});
  }
  mark_gaps(paths.odometry);
  mark_gaps(paths.given);
  return paths;
}

PoseFaults faults_of(const maps::Drive& drive, std::size_t begin,
                     std::span<const OdometryPose> odometry) {
  if (!drive.has_poses() || odometry.empty()) return {};
  const auto see_ground = [&]() -> std::optional<GroundSeen> {
    const auto matched = matched_nearest_to_middle(odometry);
    if (!matched) return std::nullopt;
    const std::size_t scan = begin + *matched;
    const Eigen::Isometry3d T = T_ground_lidar(drive.read(scan).cloud);
    if (T.matrix().isIdentity(0.0)) return std::nullopt;
    return GroundSeen{drive.T_map_lidar(scan).linear(), T.linear().transpose().col(2)};
  };
  return pose_faults(paths_of(drive, begin, odometry), see_ground);
}

}  // namespace stillmap::mapping
