#pragma once

#include "loops/loop_finder.hpp"
#include "pose_graph/pose_graph.hpp"
#include "trajectory/drive_frames.hpp"

#include <stillmap/mapping/trajectory.hpp>

#include <Eigen/Geometry>

#include <span>
#include <vector>

namespace stillmap::mapping {

/// What the drives' own poses say of the key frames, one a key frame in the map frame; empty where
/// they are not asked for.
using GivenPoses = std::vector<Eigen::Isometry3d>;

/// The graph of all key frames: odometry from each to the next of its drive, loops, and the drives'
/// own poses or positions every 10 m (errors of GNSS last for seconds; more of them would count one
/// error many times).
/// @param T_map_odom  first guess, one a drive.
[[nodiscard]] PoseGraph graph_of(std::span<const DriveKeyframe> keyframes,
                                 std::span<const Loop> loops, const GivenPoses& given,
                                 const std::vector<Eigen::Isometry3d>& T_map_odom,
                                 const TrajectoryOptions& options);

}  // namespace stillmap::mapping
