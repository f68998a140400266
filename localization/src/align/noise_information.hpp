#pragma once

#include "index/map_level.hpp"
#include "query.hpp"
#include "residual_rows.hpp"

#include <Eigen/Geometry>

namespace stillmap::localization {

/// What is measured along a direction must be so many times what noise feigns. Measured: tunnels
/// 0.9 to 2.3, where speed was lost already single scans to 5.5; highways 4.3 and more (half of
/// them above 11), streets and sparse handheld scans 18 and more.
inline constexpr double kLeastOverNoise = 3.5;

/// Variance of the tilt of the axis of the smallest variance towards another one, from n points
/// (first order perturbation of eigenvectors; Anderson 1963) [rad^2], at most 1.
[[nodiscard]] double tilt_variance(double small_m2, double other_m2, double points);

/// What the surfaces at a pose tell about it (Gauss-Newton's matrix, rows as in `covariance_of`),
/// and how much of that the noise of their normals alone would feign: a smooth wall seems to tell
/// where along it one is, as its patches are tilted a little. After Hatleskog and Alexis,
/// "Probabilistic degeneracy detection for point-to-plane error minimization", RA-L 2024: there the
/// noise is that of points and normals of a sensor model, here that of each voxel's own points. Of
/// a post only its sharper axis counts: where a sparse sensor sets a single column of points on a
/// smooth wall it seems a post, and its other axis would say where along the wall that column
/// stood.
struct NoiseInformation {
  Matrix6d measured = Matrix6d::Zero();
  Matrix6d feigned = Matrix6d::Zero();
};
/// @param kernel_m  last kernel of the alignment [m].
[[nodiscard]] NoiseInformation noise_information_of(const MapIndex::Level& level,
                                                    const Query& query,
                                                    const Eigen::Isometry3d& T_index_lidar,
                                                    float kernel_m);

/// Unit directions (rotations over the lever count as metres) that are not told: eigenvectors of
/// `measured` along which it is less than some times what noise feigns.
[[nodiscard]] std::vector<Vector6d> untold_directions(const NoiseInformation& information);

}  // namespace stillmap::localization
