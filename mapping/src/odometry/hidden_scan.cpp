#include "odometry/hidden_scan.hpp"

#include <stillmap/maps/median.hpp>

#include <algorithm>
#include <functional>
#include <string_view>
#include <vector>

namespace stillmap::mapping {
namespace {

/// Of the ranges, what lies between these shares of them; the rest may be stray.
constexpr double kShellLeast = 0.05;
constexpr double kShellMost = 0.95;
/// How far apart they may lie [m], and as a share of their median.
constexpr float kShellSpreadM = 0.35F;
constexpr float kShellSpreadOfMedian = 0.15F;
/// No place is seen from so near [m].
constexpr float kShellCoverM = 1.0F;
/// What covers a sensor is near [m].
constexpr float kFarthestShellM = 15.0F;
/// Length of the mean direction: 0 for all around evenly, 0.8 and more for a sensor that looks to
/// one side.
constexpr float kAllAround = 0.5F;

}  // namespace

bool is_shell(std::span<const Eigen::Vector3f> points_lidar) {
  if (points_lidar.empty()) return false;
  std::vector<float> ranges;
  ranges.reserve(points_lidar.size());
  Eigen::Vector3f directions = Eigen::Vector3f::Zero();
  for (const Eigen::Vector3f& p : points_lidar) {
    ranges.push_back(p.norm());
    directions += p.normalized();
  }
  const float least = maps::quantile(ranges, kShellLeast),
              most = maps::quantile(ranges, kShellMost);
  if (most > kFarthestShellM ||
      most - least > std::max(kShellSpreadM, kShellSpreadOfMedian * maps::quantile(ranges, 0.5)))
    return false;
  const float turned = directions.norm() / static_cast<float>(points_lidar.size());
  return most < kShellCoverM || turned < kAllAround;
}

std::uint64_t content_of(const maps::PointCloud& cloud) {
  if (cloud.empty()) return 0;
  const auto& positions = cloud.positions;
  return std::hash<std::string_view>{}({reinterpret_cast<const char*>(positions.data()),
                                        positions.size() * sizeof positions.front()});
}

}  // namespace stillmap::mapping
