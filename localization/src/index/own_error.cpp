#include "index/own_error.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

namespace stillmap::localization {
namespace {

constexpr double kOwnErrorColumnM = 8.0;
/// A tear turns scans from which it is seen.
constexpr int kReachColumns = 5;
/// What odometry itself is off by over 10 m, at most.
constexpr float kOdometryM = 0.04F;
constexpr float kOdometryRad = 1.5e-3F;

std::int32_t column_at(double coordinate_m) {
  return static_cast<std::int32_t>(std::floor(coordinate_m / kOwnErrorColumnM));
}

float beyond(float value, float usual) {
  return std::sqrt(std::max(0.0F, value * value - usual * usual));
}

maps::PoseDisagreement larger(const maps::PoseDisagreement& a, const maps::PoseDisagreement& b) {
  return {std::max(a.m, b.m), std::max(a.rad, b.rad)};
}

}  // namespace

std::vector<OwnErrorColumn> own_errors_of(const maps::MapPackage& map) {
  const std::vector<maps::PoseDisagreement> of_pose = maps::read_pose_disagreements(map);
  if (of_pose.empty()) return {};
  std::map<std::pair<std::int32_t, std::int32_t>, maps::PoseDisagreement> largest;
  std::size_t pose = 0;
  for (const maps::Trajectory& drive : map.trajectories()) {
    for (const maps::StampedPose& stamped : drive.poses()) {
      const maps::PoseDisagreement& told = of_pose[pose++];
      const maps::PoseDisagreement own{beyond(told.m, kOdometryM), beyond(told.rad, kOdometryRad)};
      if (own.m == 0.0F && own.rad == 0.0F) continue;
      const Eigen::Vector3d p = stamped.T_map_lidar.translation() - map.manifest().origin;
      maps::PoseDisagreement& here = largest[{column_at(p.x()), column_at(p.y())}];
      here = larger(here, own);
    }
  }
  std::vector<OwnErrorColumn> columns;
  for (const auto& [at, error] : largest) columns.push_back({at.first, at.second, error});
  return columns;
}

maps::PoseDisagreement own_error_near(std::span<const OwnErrorColumn> columns,
                                      const Eigen::Vector3d& p) {
  const std::int32_t middle_x = column_at(p.x());
  const std::int32_t middle_y = column_at(p.y());
  maps::PoseDisagreement found;
  for (std::int32_t x = middle_x - kReachColumns; x <= middle_x + kReachColumns; ++x) {
    const auto at = std::pair(x, middle_y - kReachColumns);
    auto column =
        std::partition_point(columns.begin(), columns.end(),
                             [&](const OwnErrorColumn& c) { return std::pair(c.x, c.y) < at; });
    for (; column != columns.end() && column->x == x && column->y <= middle_y + kReachColumns;
         ++column)
      found = larger(found, column->largest);
  }
  return found;
}

}  // namespace stillmap::localization
