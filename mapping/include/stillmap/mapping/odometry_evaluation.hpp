#pragma once

#include <stillmap/mapping/odometry.hpp>
#include <stillmap/mapping/progress.hpp>
#include <stillmap/mapping/projection.hpp>
#include <stillmap/maps/drive.hpp>

#include <Eigen/Geometry>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace stillmap::mapping {

/// Of many errors; NaN where there are none.
struct ErrorFigures {
  double mean = 0.0, rmse = 0.0, median = 0.0, max = 0.0;
};

/// Mean errors of KITTI's segments of one length.
struct LengthErrors {
  double length_m = 0.0;
  std::size_t segments = 0;
  double translation_percent = 0.0;
  double rotation_deg_per_100m = 0.0;
};

/// KITTI's odometry metric; NaN where the path is shorter than 100 m.
struct KittiErrors {
  std::size_t segments = 0;
  double translation_percent = 0.0;
  double rotation_deg_per_100m = 0.0;
  /// Lengths that the path reaches.
  std::vector<LengthErrors> lengths = {};
};

/// Errors of the motion between two poses.
struct RelativeErrors {
  /// Over 10 m: segments, means. NaN where the path is shorter.
  std::size_t segments_10m = 0;
  double translation_percent_10m = 0.0;
  double rotation_deg_10m = 0.0;
  /// From a pose to the next.
  ErrorFigures step_translation_m;
  ErrorFigures step_rotation_deg;
};

/// A path against the true one.
struct TrajectoryErrors {
  /// Poses with a true one, and the true way between first and last.
  std::size_t poses = 0;
  double way_m = 0.0;
  KittiErrors kitti;
  RelativeErrors relative;
  /// Distances of the positions (APE, ATE) after the rigid motion, without scale, that fits best.
  ErrorFigures aligned_m;
  /// The same with nothing but the first poses laid upon each other.
  ErrorFigures from_start_m;
  /// What fits best.
  Eigen::Isometry3d T_truth_estimate = Eigen::Isometry3d::Identity();
  /// One a pose: true way up to it, distance aligned and from the start.
  std::vector<std::array<double, 3>> course_m;
};

/// A loop between two keyframes, as it was found.
struct EvaluatedLoop {
  /// Indices of keyframes; `to` is the later one.
  std::size_t from = 0;
  std::size_t to = 0;
  Eigen::Isometry3d T_from_to = Eigen::Isometry3d::Identity();
  /// Filled by the evaluation: how far it is from the true motion.
  double translation_error_m = 0.0;
  double rotation_error_deg = 0.0;
  bool right = false;
};

/// How loops stand to the places that were driven again.
struct LoopScores {
  std::size_t found = 0, right = 0;
  std::size_t revisits = 0, revisits_found = 0;
  /// Right ones of those found; NaN where none were.
  double precision = 0.0;
  /// Keyframes at places driven before that a right loop lies at; NaN where there are none.
  double recall = 0.0;
  /// The loops with their errors.
  std::vector<EvaluatedLoop> loops;
};

}  // namespace stillmap::mapping
