#pragma once

#include <stillmap/mapping/odometry_evaluation.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::mapping {

using Path = std::span<const Eigen::Isometry3d>;

/// Way along a path up to each pose [m]; the first is 0.
[[nodiscard]] std::vector<double> ways_m(Path path);

/// How a motion along the truth differs from that along the estimate.
struct SegmentError {
  /// Index of the first and the last pose.
  std::size_t first = 0;
  std::size_t last = 0;
  /// That the segment was asked to have, and has along the truth [m].
  double length_m = 0.0;
  double way_m = 0.0;
  /// Of the estimated motion's inverse times the true motion.
  double translation_m = 0.0;
  double rotation_rad = 0.0;
};

/// Segments from every `step`-th pose to the first one that is farther than the length along the
/// truth. A length that the path does not reach has none.
/// @see Geiger, Lenz, Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark
/// suite", CVPR 2012, and the devkit of its odometry benchmark.
/// @throws std::invalid_argument when the paths have different sizes or a pose is not finite.
[[nodiscard]] std::vector<SegmentError> segment_errors(Path truth, Path estimate,
                                                       std::span<const double> lengths_m,
                                                       std::size_t step);

/// KITTI's figures: segments of 100, 200 ... 800 m from every tenth pose, each error divided by the
/// length asked for, as the devkit does; all segments count alike. NaN and no lengths where the
/// path is shorter than 100 m.
/// @note  The angle is that of the rotation's logarithm; the devkit's arc cosine of the trace says
/// the same with 1e-8 rad less resolution.
/// @throws as `segment_errors`.
[[nodiscard]] KittiErrors kitti_errors(Path truth, Path estimate);

/// Errors of the motion over 10 m from every pose, and from each pose to the next.
///
/// Over 10 m each error is divided by the way that the segment has, not by 10 m: a car of 15 m/s
/// makes 1.5 m between two scans, so its segments are up to 11.5 m long.
/// @see Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, eq. (3);
/// Grupp, "evo" (2017), RPE over metres.
/// @throws as `segment_errors`.
[[nodiscard]] RelativeErrors relative_errors(Path truth, Path estimate);

/// The rigid motion, without scale, that takes the estimate's positions to the truth's with the
/// least sum of squares.
///
/// Where positions lie on a line (a straight drive) any turn about it does the same, and where they
/// lie on a point (nothing moved) any turn at all: then the one that is nearest to laying the first
/// two poses upon each other is taken. The distances do not depend on that.
/// @see Umeyama, "Least-squares estimation of transformation parameters between two point
/// patterns", PAMI 13 (1991), eq. (38) to (41) with c = 1.
/// @throws as `segment_errors`; also without poses.
[[nodiscard]] Eigen::Isometry3d alignment_of(Path truth, Path estimate);

/// Distances of the estimate's positions from the truth's [m], after `T_truth_estimate`.
[[nodiscard]] std::vector<double> distances_m(Path truth, Path estimate,
                                              const Eigen::Isometry3d& T_truth_estimate);

/// Mean, root mean square, median and largest; NaN of nothing.
[[nodiscard]] ErrorFigures figures_of(std::vector<double> values);

/// All of them.
/// @throws as `segment_errors`; also without poses.
[[nodiscard]] TrajectoryErrors trajectory_errors(Path truth, Path estimate);

}  // namespace stillmap::mapping
