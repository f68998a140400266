#include "index/own_error.hpp"

#include <stillmap/maps/map_package.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

namespace stillmap::localization {
namespace {

constexpr double kOwnErrorColumnM = 8.0;
/// A tear turns scans from which it is seen.
constexpr int kReachColumns = 5;
/// What odometry itself is off by over 10 m, at most.
constexpr float kOdometryM = 0.04F;
constexpr float kOdometryRad = 1.5e-3F;

std::int32_t column_at(double coordinate_m) {
  return static_cast<std::int32_t>(std::floor(coordinate_m / kOwnErrorColumnM)) + kCellsPerAxis / 2;
}

float beyond(float value, float usual) {
  return std::sqrt(std::max(0.0F, value * value - usual * usual));
}

}  // namespace

OwnError::OwnError(const maps::MapPackage& map) {
  const std::vector<maps::PoseDisagreement> of_pose = maps::read_pose_disagreements(map);
  if (of_pose.empty()) return;
  std::size_t pose = 0;
  for (const maps::Trajectory& drive : map.trajectories()) {
    for (const maps::StampedPose& stamped : drive.poses()) {
      const maps::PoseDisagreement& told = of_pose[pose++];
      const maps::PoseDisagreement own{beyond(told.m, kOdometryM), beyond(told.rad, kOdometryRad)};
      if (own.m == 0.0F && own.rad == 0.0F) continue;
      const Eigen::Vector3d at = stamped.T_map_lidar.translation();
      const auto [column, inserted] =
          columns_.insert(cell_key(column_at(at.x()), column_at(at.y()), 0));
      if (inserted) largest_.emplace_back();
      maps::PoseDisagreement& largest = largest_[column];
      largest = {std::max(largest.m, own.m), std::max(largest.rad, own.rad)};
    }
  }
}

maps::PoseDisagreement OwnError::near(const Eigen::Vector3d& at_map) const {
  maps::PoseDisagreement found;
  for (int x = -kReachColumns; x <= kReachColumns; ++x) {
    for (int y = -kReachColumns; y <= kReachColumns; ++y) {
      const std::uint32_t column =
          columns_.find(cell_key(column_at(at_map.x()) + x, column_at(at_map.y()) + y, 0));
      if (column == VoxelTable::kNone) continue;
      found = {std::max(found.m, largest_[column].m), std::max(found.rad, largest_[column].rad)};
    }
  }
  return found;
}

}  // namespace stillmap::localization
