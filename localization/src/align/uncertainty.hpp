#pragma once

#include "index/map_level.hpp"
#include "query.hpp"
#include "registration.hpp"

#include <Eigen/Geometry>

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

namespace stillmap::localization {

/// Deviations by which moving must worsen the fit. In a synthetic corridor the score along it stays
/// within 2, on simulated highways with posts it is 4 to 7, in streets 11 and more.
constexpr double kMinProbeScore = 4.0;

/// Fills in the costs of the points from a number on.
using CostsThere = std::function<void(std::size_t first, std::span<float> costs)>;
/// Whether costs are higher at another pose than `here`, by more than `kMinProbeScore` deviations
/// of the mean rise. Asks for no more of them than it takes to be certain.
/// @param here  each in [0, 1], as those of the other pose.
[[nodiscard]] bool rise(const std::vector<float>& here, const CostsThere& cost_there);

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

}  // namespace stillmap::localization
