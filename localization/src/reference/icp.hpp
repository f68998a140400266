#pragma once

#include "reference/terms.hpp"

namespace stillmap::localization {

/// Rotation and translation that bring `from` to `to` with the smallest sum of squares: centroids
/// and an SVD of the cross-covariance, never a reflection.
/// @param from, to  N points each [m], pairwise; N >= 1. Fewer than 3 or points in a line leave a
///                  rotation open, and the smallest-index solution of the SVD is taken.
/// @see Umeyama, "Least-squares estimation of transformation parameters between two point
/// patterns", PAMI 1991, eq. (40) to (42), scale 1.
/// @throws std::invalid_argument if the counts differ or are zero.
[[nodiscard]] Eigen::Isometry3d best_rigid(std::span<const Eigen::Vector3d> from,
                                           std::span<const Eigen::Vector3d> to);

/// Point-to-point ICP (Besl, McKay, PAMI 1992), with which the paper measures localization (section
/// IV.A): every scan point and its nearest map point, the closed form, again. No weights, no
/// rejection but the distance. The paper's prior is the true pose of the scan before; it says
/// nothing of thinning, pair distance or end, so these are what users of PCL write: cells of 0.5 m
/// for map and scan, pairs within 2 m, at most 60 rounds.
[[nodiscard]] const ReferenceMethod& icp();

}  // namespace stillmap::localization
