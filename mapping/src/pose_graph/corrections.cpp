#include "pose_graph/corrections.hpp"

#include <stillmap/maps/frames.hpp>

#include <fmt/format.h>

#include <stdexcept>

namespace stillmap::mapping {
namespace {

using Poses = std::vector<Eigen::Isometry3d>;

/// Below this [m] a vehicle stood: its way is the odometry's jitter.
constexpr double kStandingM = 1e-3;

void check(const Poses& T_odom_lidar, const std::vector<std::size_t>& keyframes,
           const Poses& T_map_lidar) {
  if (keyframes.empty() || keyframes.size() != T_map_lidar.size())
    throw std::invalid_argument(fmt::format("corrections: {} keyframes with {} poses",
                                            keyframes.size(), T_map_lidar.size()));
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    if (keyframes[k] >= T_odom_lidar.size())
      throw std::invalid_argument(fmt::format("corrections: keyframe {} is scan {} of {}", k,
                                              keyframes[k], T_odom_lidar.size()));
    if (k > 0 && !(keyframes[k] > keyframes[k - 1]))
      throw std::invalid_argument(fmt::format("corrections: keyframe {} is scan {}, after scan {}",
                                              k, keyframes[k], keyframes[k - 1]));
  }
}

/// Shares of the way from scan `begin` to scan `end` at the scans in between, both ends included.
std::vector<double> shares_of_way(const Poses& T_odom_lidar, std::size_t begin, std::size_t end) {
  std::vector<double> way_m{0.0};
  for (std::size_t i = begin + 1; i <= end; ++i)
    way_m.push_back(way_m.back() +
                    (T_odom_lidar[i].translation() - T_odom_lidar[i - 1].translation()).norm());
  const double all_m = way_m.back();
  for (std::size_t i = 0; i < way_m.size(); ++i)
    way_m[i] = all_m > kStandingM ? way_m[i] / all_m
                                  : static_cast<double>(i) / static_cast<double>(end - begin);
  return way_m;
}

}  // namespace

std::vector<Eigen::Isometry3d> corrected_poses(const Poses& T_odom_lidar,
                                               const std::vector<std::size_t>& keyframes,
                                               const Poses& T_map_lidar) {
  check(T_odom_lidar, keyframes, T_map_lidar);
  const auto correction = [&](std::size_t k) {
    return T_map_lidar[k] * T_odom_lidar[keyframes[k]].inverse();
  };
  Poses out;
  out.reserve(T_odom_lidar.size());
  for (std::size_t i = 0; i < keyframes.front(); ++i)
    out.push_back(maps::renormalized(correction(0) * T_odom_lidar[i]));
  for (std::size_t k = 0; k + 1 < keyframes.size(); ++k) {
    const std::size_t begin = keyframes[k], end = keyframes[k + 1];
    const std::vector<double> shares = shares_of_way(T_odom_lidar, begin, end);
    out.push_back(T_map_lidar[k]);
    for (std::size_t i = begin + 1; i < end; ++i) {
      // In the scan's own frame, where no lever arm of the map's origin blows rotations up.
      const Eigen::Isometry3d T_from_before = correction(k) * T_odom_lidar[i];
      const Eigen::Isometry3d T_from_after = correction(k + 1) * T_odom_lidar[i];
      const Eigen::Matrix<double, 6, 1> step =
          shares[i - begin] * maps::log_se3(T_from_before.inverse() * T_from_after);
      out.push_back(maps::renormalized(T_from_before * maps::exp_se3(step)));
    }
  }
  out.push_back(T_map_lidar.back());
  for (std::size_t i = keyframes.back() + 1; i < T_odom_lidar.size(); ++i)
    out.push_back(maps::renormalized(correction(keyframes.size() - 1) * T_odom_lidar[i]));
  return out;
}

}  // namespace stillmap::mapping
