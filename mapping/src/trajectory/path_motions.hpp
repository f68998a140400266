#pragma once

#include "trajectory/smooth_path.hpp"

#include <Eigen/Geometry>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace stillmap::mapping {

/// Fewer motions of a drive tell nothing.
inline constexpr std::size_t kFewestMotions = 20;

/// Scans' motions, how they would look a little earlier and later, and when they began.
struct PathMotion {
  double t_s = 0.0;
  Eigen::Isometry3d T, T_earlier, T_later;
};

struct PathMotions {
  double length_s = 0.0;
  double box_s = 0.0;
  /// Of `T_earlier` and `T_later`.
  double aside_s = 0.0;
  /// From each to the next, but for pauses.
  double apart_s = 0.0;
  std::vector<PathMotion> all;

  /// Stretches among so many motions that are independent.
  [[nodiscard]] double independent(std::size_t motions) const {
    return static_cast<double>(motions) * std::min(1.0, apart_s / (length_s + box_s));
  }
};

/// Motions of a smoothed path from each of its poses, or each so many: pauses hold none.
/// @param box_s   over which it is smoothed. @param step_s  usual one of its poses.
[[nodiscard]] PathMotions motions_of(const std::vector<SmoothPath::Pose>& poses, double box_s,
                                     double step_s);

}  // namespace stillmap::mapping
