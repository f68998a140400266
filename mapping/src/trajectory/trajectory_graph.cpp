#include "trajectory/trajectory_graph.hpp"

#include "pose_graph/graph_checks.hpp"

namespace stillmap::mapping {
namespace {

/// Key frames whose given pose counts: the first and the last of each drive, and some between.
std::vector<std::size_t> anchors_of(std::span<const DriveKeyframe> keyframes) {
  std::vector<std::size_t> anchors;
  double way_m = 0.0;
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    const bool first = k == 0 || keyframes[k].drive != keyframes[k - 1].drive;
    const bool last = k + 1 == keyframes.size() || keyframes[k + 1].drive != keyframes[k].drive;
    way_m += keyframes[k].T_before_this.translation().norm();
    if (!first && !last && way_m < kGivenApartM) continue;
    anchors.push_back(k);
    way_m = 0.0;
  }
  return anchors;
}

void add_given(PoseGraph& graph, std::span<const DriveKeyframe> keyframes,
               const GivenPoses& given) {
  if (given.T_map_keyframe.empty()) return;
  const double variance_m2 = given.sigma_m * given.sigma_m;
  for (const std::size_t k : anchors_of(keyframes)) {
    const Eigen::Isometry3d& T = given.T_map_keyframe[k];
    if (!given.sigma_rad) {
      graph.absolute_positions.push_back({.node = k,
                                          .position_map_m = T.translation(),
                                          .covariance = variance_m2 * Eigen::Matrix3d::Identity(),
                                          .doubtful = given.doubtful});
      continue;
    }
    Eigen::Matrix<double, 6, 1> variances;
    variances.head<3>().setConstant(variance_m2);
    variances.tail<3>().setConstant(*given.sigma_rad * *given.sigma_rad);
    graph.absolute_poses.push_back({.node = k,
                                    .T_map_node = T,
                                    .covariance = variances.asDiagonal(),
                                    .doubtful = given.doubtful});
  }
}

}  // namespace

PoseGraph graph_of(std::span<const DriveKeyframe> keyframes, std::span<const Loop> loops,
                   const GivenPoses& given, const std::vector<Eigen::Isometry3d>& T_ground_odom) {
  PoseGraph graph;
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    const DriveKeyframe& keyframe = keyframes[k];
    graph.nodes.push_back(T_ground_odom[keyframe.drive] * keyframe.T_odom_lidar);
    if (k == 0 || keyframes[k - 1].drive != keyframe.drive) continue;
    graph.relative_poses.push_back({.from = k - 1,
                                    .to = k,
                                    .T_from_to = keyframe.T_before_this,
                                    .covariance = keyframe.covariance});
  }
  for (const Loop& loop : loops) {
    graph.relative_poses.push_back({.from = loop.from,
                                    .to = loop.to,
                                    .T_from_to = loop.T_from_to,
                                    .covariance = loop.covariance,
                                    .doubtful = true});
  }
  add_given(graph, keyframes, given);
  return graph;
}

std::optional<std::size_t> drive_apart(std::size_t drives, std::span<const DriveKeyframe> keyframes,
                                       std::span<const Loop> loops) {
  JoinedSets sets(drives);
  for (const Loop& loop : loops) sets.join(keyframes[loop.from].drive, keyframes[loop.to].drive);
  for (std::size_t drive = 1; drive < drives; ++drive) {
    if (sets.set_of(drive) != sets.set_of(0)) return drive;
  }
  return std::nullopt;
}

}  // namespace stillmap::mapping
