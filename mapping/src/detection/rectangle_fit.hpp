#pragma once

#include <Eigen/Core>

#include <vector>

namespace stillmap::mapping {

/// An upright rectangle around points, seen from above.
struct Rectangle {
  /// Direction of the first side [rad], in [0, pi / 2).
  double yaw_rad = 0.0;
  /// Bounds along the first and the second side, from the frame's origin [m].
  Eigen::Vector2d min = Eigen::Vector2d::Zero();
  Eigen::Vector2d max = Eigen::Vector2d::Zero();
  /// Share of points within 0.2 m of the nearest side, in [0, 1]: 1 for a clean outline.
  double outline_share = 0.0;

  [[nodiscard]] Eigen::Vector2d size() const { return max - min; }
  /// From along-the-sides to the frame of the points.
  [[nodiscard]] Eigen::Vector2d to_frame(const Eigen::Vector2d& along) const;
};

/// The rectangle whose sides the points lie closest to (closeness criterion of Zhang et al., IV
/// 2017, algorithm 4), in steps of 2 degrees. @param points  at least one.
[[nodiscard]] Rectangle fit_rectangle(const std::vector<Eigen::Vector2d>& points);

}  // namespace stillmap::mapping
