#include "trajectory/corrected_poses.hpp"

#include <stillmap/maps/frames.hpp>

#include <stdexcept>

namespace stillmap::mapping {
namespace {

/// Way from the scan `from` to each after it, up to `to` [m]. A little is added for each scan, so
/// that standing ones are spread too.
std::vector<double> ways_from(std::span<const OdometryPose> odometry, std::size_t from,
                              std::size_t to) {
  constexpr double kStandingM = 1e-3;
  std::vector<double> ways{0.0};
  for (std::size_t scan = from + 1; scan <= to; ++scan) {
    const Eigen::Vector3d step =
        odometry[scan].T_odom_lidar.translation() - odometry[scan - 1].T_odom_lidar.translation();
    ways.push_back(ways.back() + step.norm() + kStandingM);
  }
  return ways;
}

}  // namespace

std::vector<Eigen::Isometry3d> corrected_poses(std::span<const OdometryPose> odometry,
                                               std::span<const std::size_t> keyframes,
                                               std::span<const Eigen::Isometry3d> T_map_keyframe) {
  if (keyframes.size() != T_map_keyframe.size() || keyframes.empty() ||
      keyframes.back() >= odometry.size())
    throw std::invalid_argument("corrected_poses: key frames that do not fit the scans");
  const auto after = [&](std::size_t k, std::size_t scan) {
    const Eigen::Isometry3d& T_odom_keyframe = odometry[keyframes[k]].T_odom_lidar;
    return Eigen::Isometry3d(T_map_keyframe[k] *
                             (T_odom_keyframe.inverse() * odometry[scan].T_odom_lidar));
  };
  std::vector<Eigen::Isometry3d> poses;
  poses.reserve(odometry.size());
  for (std::size_t scan = 0; scan < keyframes.front(); ++scan)
    poses.push_back(maps::renormalized(after(0, scan)));
  for (std::size_t k = 0; k + 1 < keyframes.size(); ++k) {
    const std::vector<double> ways = ways_from(odometry, keyframes[k], keyframes[k + 1]);
    poses.push_back(T_map_keyframe[k]);
    for (std::size_t scan = keyframes[k] + 1; scan < keyframes[k + 1]; ++scan) {
      const Eigen::Isometry3d from_before = after(k, scan);
      const Eigen::Isometry3d from_after = after(k + 1, scan);
      const double share = ways[scan - keyframes[k]] / ways.back();
      poses.push_back(maps::renormalized(
          from_before * maps::exp_se3(share * maps::log_se3(from_before.inverse() * from_after))));
    }
  }
  poses.push_back(T_map_keyframe.back());
  for (std::size_t scan = keyframes.back() + 1; scan < odometry.size(); ++scan)
    poses.push_back(maps::renormalized(after(keyframes.size() - 1, scan)));
  return poses;
}

}  // namespace stillmap::mapping
