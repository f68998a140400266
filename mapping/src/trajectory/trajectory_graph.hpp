#pragma once

#include "loops/loop_finder.hpp"
#include "pose_graph/pose_graph.hpp"

#include <stillmap/mapping/trajectory.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// A scan of a drive that stands for those around it.
struct DriveKeyframe {
  std::size_t drive = 0;
  std::size_t scan = 0;
  Eigen::Isometry3d T_odom_lidar = Eigen::Isometry3d::Identity();
  /// From the key frame of the drive before it, and its covariance; identity and zero for the
  /// first.
  Eigen::Isometry3d T_before_this = Eigen::Isometry3d::Identity();
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
};

/// What the drives' own poses say of the key frames.
struct GivenPoses {
  /// One a key frame, in the map frame; empty where they are not asked for.
  std::vector<Eigen::Isometry3d> T_map_keyframe;
  /// How well they are known, in each direction [m, rad]. Without the latter positions alone count.
  double sigma_m = 0.0;
  std::optional<double> sigma_rad;
  /// Any of them may be plainly wrong.
  bool doubtful = false;
};

/// The drives' own poses count at the first and the last key frame of a drive and so far apart
/// between [m]: errors of GNSS last for seconds, and more of them would count one error many times.
inline constexpr double kGivenApartM = 10.0;

/// The graph of all key frames: odometry from each to the next of its drive, loops, and the drives'
/// own poses or positions.
/// @param T_ground_odom  one a drive: first guesses are upright; where they lie, the solver finds.
[[nodiscard]] PoseGraph graph_of(std::span<const DriveKeyframe> keyframes,
                                 std::span<const Loop> loops, const GivenPoses& given,
                                 const std::vector<Eigen::Isometry3d>& T_ground_odom);

/// @return the first drive that no chain of loops joins with drive 0.
[[nodiscard]] std::optional<std::size_t> drive_apart(std::size_t drives,
                                                     std::span<const DriveKeyframe> keyframes,
                                                     std::span<const Loop> loops);

}  // namespace stillmap::mapping
