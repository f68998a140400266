#pragma once

#include <stillmap/mapping/odometry_evaluation.hpp>

#include <string>

namespace stillmap::mapping {

/// Each is one drawing as inline SVG: the truth grey, odometry alone in colour 0, with loops in
/// colour 2.

/// From above, both axes alike, paths laid onto the truth; loops as lines, wrong ones red. A loop
/// between places that lie upon each other is a dot.
[[nodiscard]] std::string path_figure(const OdometryEvaluation& evaluation);
/// Heights along the way, laid onto the truth.
[[nodiscard]] std::string height_figure(const OdometryEvaluation& evaluation);
/// Distance from the truth along the way, after the best rigid motion, and from the start alone.
[[nodiscard]] std::string aligned_figure(const OdometryEvaluation& evaluation);
[[nodiscard]] std::string from_start_figure(const OdometryEvaluation& evaluation);
/// KITTI's errors by length of segment.
[[nodiscard]] std::string translation_by_length_figure(const OdometryEvaluation& evaluation);
[[nodiscard]] std::string rotation_by_length_figure(const OdometryEvaluation& evaluation);

}  // namespace stillmap::mapping
