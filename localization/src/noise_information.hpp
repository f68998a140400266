#pragma once

#include "map_level.hpp"
#include "query.hpp"
#include "residual_rows.hpp"

#include <Eigen/Geometry>

namespace stillmap::localization {

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
