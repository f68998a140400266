#pragma once

#include <stillmap/mapping/odometry_evaluation.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping {

/// Judges loops by the true poses of the keyframes, in the order in which they were driven.
///
/// A keyframe is a revisit when an earlier one, at least 50 m of path before it, lies within 5 m,
/// whatever the heading. It is found when a loop that is right ends within 5 m of path of it: one
/// loop a few metres on holds it as well. A loop is right when it is within 0.5 m and 2 deg of the
/// true motion.
/// @param path  one true pose a keyframe; its way is measured along `way_m`, so that what lies
/// between keyframes counts.
/// @param way_m  one a keyframe, not decreasing [m].
/// @throws std::invalid_argument on sizes that differ or a loop to a keyframe that is not there.
[[nodiscard]] LoopScores score_loops(std::span<const Eigen::Isometry3d> path,
                                     std::span<const double> way_m,
                                     std::span<const EvaluatedLoop> loops);

}  // namespace stillmap::mapping
