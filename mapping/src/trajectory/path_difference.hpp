#pragma once

#include "trajectory/smooth_path.hpp"

#include <Eigen/Geometry>

#include <limits>
#include <optional>
#include <vector>

namespace stillmap::mapping {

/// A value and its standard deviation; errors of neighbouring poses count as correlated.
struct Measured {
  double value = 0.0;
  double sigma = std::numeric_limits<double>::infinity();

  /// Whether it lies so many deviations from another value.
  [[nodiscard]] bool is_off(double other, double deviations) const {
    return value < other - deviations * sigma || value > other + deviations * sigma;
  }
};

/// One drive's poses from two sources, each by its own clock [s].
struct PathPair {
  /// `follows` is false where odometry did not see the motion.
  std::vector<SmoothPath::Pose> odometry;
  std::vector<SmoothPath::Pose> given;
};

/// What turns the motion that odometry found into that of the given poses.
struct PathDifference {
  /// Else numbers are those of the last step, and their deviations mean nothing.
  bool converged = false;
  /// To be added to the stamps of the given poses [s].
  Measured offset_s;
  /// Given lengths over those of odometry.
  Measured scale{1.0};
  /// The given poses are of a frame that lies so to the lidar: takes directions of the lidar there.
  Eigen::Matrix3d R_given_lidar = Eigen::Matrix3d::Identity();
  /// Of a turn in the axes of the lidar [rad^2].
  Eigen::Matrix3d R_covariance = Eigen::Matrix3d::Zero();
  /// Place of the lidar in that frame [m, less the scale], with the deviation on each axis.
  Eigen::Vector3d lever_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d lever_sigma_m = Eigen::Vector3d::Zero();
  /// Deviation of a motion in each direction that is left.
  double residual_m = 0.0;
  double residual_rad = 0.0;
  /// Of motions, those that are more than 5 deviations off, by way or turn: where odometry has lost
  /// its way, or poses jump.
  double outlier_share = 0.0;
  /// Median length of a given motion [m].
  double usual_m = 0.0;
  /// Of given motions about their mean, the share that the turned and shifted ones explain: of
  /// translations and of turns, in (-inf, 1].
  double explained_m = 0.0;
  double explained_rad = 0.0;
  /// Stretches whose errors count as independent.
  double independent = 0.0;
};

/// Compares motions over a second. The clocks are first brought together by how fast the sensor
/// moves and turns, up to 120 s, which needs no frame; then offset, turn, lever and scale are
/// fitted to motions by least squares.
/// @param mirrored  the y of the lidar counts as turned round, as in scans with left-handed axes.
/// @param offset_s  where least squares begin, instead of what is found at all lags.
/// @return nothing where too little is common (6 s, and motions of four box lengths).
[[nodiscard]] std::optional<PathDifference> path_difference(const PathPair& paths,
                                                            bool mirrored = false,
                                                            std::optional<double> offset_s = {});

/// The part of the drive whose scans lie in [begin_s, end_s); all given poses.
[[nodiscard]] PathPair part_of(const PathPair& paths, double begin_s, double end_s);

}  // namespace stillmap::mapping
