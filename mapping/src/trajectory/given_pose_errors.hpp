#pragma once

#include "loops/loop_finder.hpp"
#include "trajectory/trajectory_graph.hpp"
#include "views/posed_views.hpp"

#include <stillmap/mapping/trajectory.hpp>

#include <Eigen/Geometry>

#include <span>
#include <vector>

namespace stillmap::mapping {

/// Lengths of differences between poses, or between motions.
struct DifferenceList {
  std::vector<double> lengths_m, angles_rad;

  void add(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b);
  void append(const DifferenceList& other);
};

/// @param list   is reordered.
/// @param way_m  as it is passed on.
[[nodiscard]] PoseDifferences summary(DifferenceList& list, double way_m = 0.0);

/// What odometry and the drive's own poses say of the same scans.
struct TwicePosed {
  std::span<const OdometryPose> odometry;
  std::span<const Eigen::Isometry3d> T_map_given;
};

/// Compares motions between scans that are 0 (neighbours), 3, 10, 30 and 100 m of way apart. A
/// deviation of a pose in each direction follows from the median length of such a difference, which
/// holds two poses' errors in three directions: median = 1.538 sqrt(2) sigma for normal ones. The
/// largest of all ways counts, and the direction of the longest way counts as an angle. Odometry's
/// own drift is in it: given poses that are better than odometry are believed a little less than
/// they could be.
[[nodiscard]] GivenPoseErrors given_pose_errors(std::span<const TwicePosed> drives);

/// How far each given pose disagrees with those around it, by the same differences to neighbours
/// and to scans 10 m on: the median over those of 5 scans before and after, of which each of the
/// two poses has its part.
[[nodiscard]] std::vector<maps::PoseDisagreement> doubts_of(const TwicePosed& drive);
/// Poses as odometry found them agree, but for those that it placed by motion alone.
[[nodiscard]] std::vector<maps::PoseDisagreement> doubts_of(std::span<const OdometryPose> odometry);

/// How far the map is bent or torn at each scan: the largest difference over 10 m of way from it or
/// to it that the pair before or after confirms. A fast drive crosses a tear in few scans, which a
/// median would not show. Within 15 m of a drive's start odometry tells nothing of that.
[[nodiscard]] std::vector<maps::PoseDisagreement> disagreements_of(const TwicePosed& drive);

/// Loops tell of errors that go together over longer ways than these, or differ between drives.
/// @param T_map_given  one a key frame.
void widen_by_loops(std::span<const Loop> loops, std::span<const Eigen::Isometry3d> T_map_given,
                    GivenPoseErrors& errors);

}  // namespace stillmap::mapping
