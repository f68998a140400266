#pragma once

#include "odometry/lever.hpp"
#include "odometry/loam/surfaces.hpp"
#include "odometry/loam/sweep_motion.hpp"

#include <Eigen/Core>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping::loam {

using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// A feature and what it should lie on.
struct Correspondence {
  /// As measured [m], at `share` of the motion.
  Eigen::Vector3d X = Eigen::Vector3d::Zero();
  Share share;
  /// In the frame that the motion leads to.
  Surface surface;
};

/// Directions in which a motion is told, and not (Zhang, Kaess, Singh, "On degeneracy of
/// optimization-based state estimation problems", ICRA 2016): eigenvectors of J^T J, rotations
/// counted in metres at `kLeverM`, so that all six are alike.
struct Told {
  /// 6 x n, orthonormal, in the scaled coordinates.
  Eigen::Matrix<double, 6, Eigen::Dynamic> directions = Matrix6::Identity();
  std::vector<Eigen::Matrix<double, 6, 1>> untold;
};

struct MotionFit {
  Motion T = Motion::Zero();
  /// J^T W J at the end, of metres and radians.
  Matrix6 information = Matrix6::Zero();
  /// Weighted mean square of the distances [m^2].
  double variance_m2 = 0.0;
  /// Rotation and translation of the whole fit were below what matters.
  bool settled = false;
};

/// Which directions the correspondences tell, at T.
[[nodiscard]] Told told_by(std::span<const Correspondence> correspondences, const Motion& T);

/// Some steps of Levenberg and Marquardt, eq. (12), on f(T) = d, eq. (11), whose rows are the
/// distances of eq. (9) and (10), with bisquare weights: 1 at no distance, 0 beyond 4.685 robust
/// deviations of all distances (section V.C: farther ones weigh less, outliers nothing).
/// @param correspondences  6 rows or more, else nothing moves.
/// @param reach_m  weights reach at least so far, > 0: what T may be off by. Most of a street tells
/// nothing about the way along it, so a T that is a metre off there has a small median.
[[nodiscard]] MotionFit fit_motion(std::span<const Correspondence> correspondences, const Motion& T,
                                   const Told& told, double reach_m);

/// A feature this near to its line or plane counts as on it [m].
inline constexpr double kInlierM = 0.2;
[[nodiscard]] std::size_t inliers(std::span<const Correspondence> correspondences, const Motion& T);

}  // namespace stillmap::mapping::loam
