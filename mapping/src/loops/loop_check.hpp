#pragma once

#include "loops/loop_finder.hpp"
#include "loops/odometry_path.hpp"
#include "loops/proposals.hpp"
#include "loops/submaps.hpp"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace stillmap::mapping {

/// Aligns what a keyframe saw with the map of the stretch around a place.
///
/// @param view  of the query, in its lidar frame [m].
/// @return a loop to the keyframe taken nearest to where the query was found; nothing unless the
/// aligner is sure of the place (directions that it cannot tell have their covariance), enough of
/// the view lies on the map, and odometry with its drift allows it.
[[nodiscard]] std::optional<Loop> check_loop(const Proposal& proposal,
                                             const std::vector<Eigen::Vector3f>& view,
                                             const Submap& submap, const OdometryPath& path);

/// Which loops others agree with: a lone one that aligns by chance is the wrong loop that spoils a
/// map, while a true revisit is met by neighbouring keyframes, which odometry ties together.
/// @return one flag a loop.
[[nodiscard]] std::vector<char> agreed_loops(const std::vector<Loop>& loops,
                                             const OdometryPath& path);

}  // namespace stillmap::mapping
