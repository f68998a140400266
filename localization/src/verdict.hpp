#pragma once

#include "map_level.hpp"
#include "query.hpp"
#include "registration.hpp"

#include <stillmap/localization/aligner.hpp>

#include <Eigen/Geometry>

#include <cstddef>
#include <span>
#include <vector>

namespace stillmap::localization {

/// How well a pose explains a scan.
struct Support {
  /// Share of all points that lie on the map's surfaces.
  double inlier_ratio = 0.0;
  /// Root mean square distance of the inliers to their surface [m].
  double rmse_m = 0.0;
  /// Points that stand and lie where the map knows anything, and the share of all standing points.
  std::size_t known_standing = 0;
  double known_ratio = 0.0;
  /// Share of the known standing points that lie on the map: unlike ground, these do not fit
  /// anywhere.
  double standing_ratio = 0.0;
  /// `inlier_ratio` of the points that have a voxel of the finest level around them.
  double known_inlier_ratio = 0.0;
};
/// @param levels  of a map, coarse to fine, at least one.
[[nodiscard]] Support support_of(std::span<const MapIndex::Level> levels, const Query& query,
                                 const Eigen::Isometry3d& T_index_lidar, std::size_t stride = 1);

/// What the scan says about each direction at a pose.
struct Observability {
  /// Unit directions (rotations over the lever count as metres) along which moving the scan does
  /// not make it fit significantly worse.
  std::vector<Vector6d> degenerate;
};
/// Moves the pose both ways along each of the weakest eigenvectors of H and compares point by
/// point. The eigenvalues alone would not do: noise of the normals gives every direction some
/// information.
[[nodiscard]] Observability observability_of(const MapIndex::Level& level, const Query& query,
                                             const Eigen::Isometry3d& T_index_lidar,
                                             const Matrix6d& H);

/// Covariance of a pose from residuals summed in blocks of space, so that errors which neighbours
/// share (a voxel's mean, a bent wall, a car that moved) count once: H^-1 (sum_b g_b g_b^T) H^-1
/// (Huber's sandwich, clustered); more where the map's surfaces are thicker than a map's with
/// exact poses, and where near points and all alike place the scan differently; and a floor for
/// what all points share. Degenerate directions get `kUnknownM`. Its factors are calibrated on
/// simulated drives (localization/how_it_works.md).
/// @param bend  from the pose to the one by near points, (tx ty tz rx ry rz) in the lidar frame.
[[nodiscard]] Matrix6d covariance_of(const ResidualRows& rows,
                                     const Eigen::Isometry3d& T_index_lidar, float kernel_m,
                                     const Vector6d& bend, const std::vector<Vector6d>& degenerate);

/// Inputs of the verdict, apart from the pose.
struct Evidence {
  Support support;
  Observability observability;
  /// A second place explains the scan about as well.
  bool ambiguous = false;
  /// The prior's covariance speaks against the pose.
  bool contradicts_prior = false;
  /// The scan was taken on the move and does not say when its points were.
  bool not_deskewed = false;
};
/// Sets status and reasons. Lost: nothing to support a pose; degraded: something is weak; ok: all
/// is well.
void judge(const Evidence& evidence, const Matrix6d& covariance, AlignmentResult& result);

}  // namespace stillmap::localization
